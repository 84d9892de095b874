// What a queue counts, sums of work-groups, and a processor that is taken for a GPU.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include "service/device/device.h"
#include "tests/support/faulty_kernels.h"

namespace teletact::service {
namespace {

// Kernels of its own beside the product's.
class DeviceWork_ : public FaultyKernels {
 protected:
  void SetUp() override {
    FaultyKernels::SetUp();
    put("scale.cl", R"(
kernel void scale(global const real* restrict x, global real* restrict y, const int n) {
  const int i = get_global_id(0);
  if (i < n) y[i] = 2 * x[i];
}
)");
  }
  void put(const std::string& name, const std::string& text) { std::ofstream(folder_ / name) << text; }
};

TEST_F(DeviceWork_, CountsWhatItIsAskedFor) {
  const Queue queue = Device::open(options_)->queue();
  Kernel kernel = queue.kernel("scale", "scale", Precision::kFloat);
  queue.take_work();
  auto x = queue.array(std::vector<float>(64, 1.0f)), y = queue.array<float>(64);  // waits
  queue.fill_zero(y);
  kernel({{64}, {64}, 7}, x, y, 64);
  kernel({{64}, {64}, 3}, x, y, 64);
  kernel({{0}, {64}, 1000}, x, y, 64);  // nothing to do
  const float two = 2;
  queue.send(x, &two, 1);
  std::vector<float> early(64), late(64);
  Arrival arrival = queue.fetch(y, early.data(), early.size());
  kernel({{64}, {64}}, x, y, 64);
  arrival.wait();
  arrival.wait();  // is here
  queue.read(y, late.data(), late.size());
  const DeviceWork work = queue.take_work();
  EXPECT_EQ(work.launches, 3u);
  EXPECT_EQ(work.copies, 3u);
  EXPECT_EQ(work.waits, 2u);
  EXPECT_EQ(work.looks, 1u);
  EXPECT_EQ(work.bytes_to, 65 * sizeof(float));
  EXPECT_EQ(work.bytes_from, 128 * sizeof(float));
  EXPECT_EQ(work.longest_chain, 7u);
  EXPECT_EQ(work.chained, 11u);
  EXPECT_EQ(queue.take_work().launches, 0u);
  EXPECT_EQ(early, std::vector<float>(64, 2.0f)) << "in order";
  EXPECT_EQ(late.front(), 4.0f);
}

// By a tree or by one item in lanes: nearer to the sum in double than one float chain is, beyond the largest
// solid.
TEST_F(DeviceWork_, SumsOfAGroupAreTruerThanAChain) {
  put("added.cl", R"(
#include "sums.clh"
kernel OF_GROUP void added(global const accum* restrict x, global accum* restrict y, const int count) {
  local accum shared[GROUP];
  const accum sum = sum_of(x, count, shared);
  y[get_global_id(0)] = sum;
}
)");
  const Queue queue = Device::open(options_)->queue();
  for (const std::size_t count : {std::size_t{1}, std::size_t{7}, std::size_t{1000}, std::size_t{336'001}}) {
    std::vector<float> x;
    for (std::size_t n = 0; n < count; ++n) x.push_back(1 + 0.37f * std::sin(0.7f * static_cast<float>(n)));
    float chain = 0;
    double sum = 0;
    for (const float value : x) chain += value, sum += value;
    const auto values = queue.array(x);
    for (const std::size_t group : {1U, 4U, 64U}) {
      Kernel added = queue.kernel("added", "added", Precision::kFloat, {{"GROUP", std::to_string(group)}});
      auto y = queue.array<float>(group);
      added({{group}, {group}}, values, y, static_cast<int>(count));
      for (const float found : queue.read(y)) {  // every item has it
        EXPECT_LE(std::abs(found - sum), std::abs(chain - sum) + 2 * 6e-8 * sum) << count << " by " << group;
        EXPECT_NEAR(found / sum, 1, group == 1 ? 1e-3 : 1e-5) << count << " by " << group;
      }
    }
  }
}

TEST_F(DeviceWork_, AProcessorCanBeTakenForAGpu) {
  options_.as_gpu = true;
  const auto device = Device::open(options_);
  EXPECT_TRUE(device->info().gpu);
  EXPECT_EQ(device->info().width<float>(), 1u);
}

}  // namespace
}  // namespace teletact::service
