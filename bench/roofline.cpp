#include "bench/roofline.h"

#include <algorithm>
#include <chrono>
#include <functional>

namespace teletact::bench {
namespace {

using nlohmann::json;

double at_best(int repeats, const std::function<void()>& once) {
  double least = 1e300;
  for (int k = 0; k <= repeats; ++k) {  // the first compiles
    const auto begin = std::chrono::steady_clock::now();
    once();
    const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - begin;
    if (k > 0) least = std::min(least, spent.count());
  }
  return least;
}

}  // namespace

Ceiling measure_ceiling(const service::Queue& queue) {
  constexpr std::size_t kVectors = std::size_t{1} << 20, kItems = 1 << 14;  // 32 MiB an array
  constexpr int kChains = 8, kSteps = 256, kRepeats = 40;                   // chains of roofline.cl
  const auto a = queue.array<float>(8 * kVectors);
  auto b = queue.array<float>(8 * kVectors), c = queue.array<float>(8 * kVectors);
  queue.fill_zero(b), queue.fill_zero(c);
  auto triad = queue.kernel("roofline", "triad", service::Precision::kFloat);
  auto chains = queue.kernel("roofline", "multiply_add", service::Precision::kFloat);
  const double triad_s = at_best(kRepeats, [&] {
    triad({{kVectors}, {64}}, b, c, a, 0.5f, static_cast<int>(kVectors));
    queue.finish();
  });
  const double chains_s = at_best(kRepeats, [&] {
    chains({{kItems}, {64}}, a, 0.999f, kSteps);
    queue.finish();
  });
  return {3.0 * 32 * kVectors / triad_s, 16.0 * kChains * kSteps * kItems / chains_s};
}

json kernels_of(const service::Queue& queue, const std::map<std::string, Work>& work, const Ceiling& ceiling,
                int runs) {
  json rows = json::array();
  std::vector<service::KernelTime> times = queue.profile();
  std::sort(times.begin(), times.end(), [](const auto& a, const auto& b) { return a.seconds > b.seconds; });
  for (const service::KernelTime& t : times) {
    const double seconds = t.seconds / runs, launches = static_cast<double>(t.launches) / runs;
    json row{{"kernel", t.name}, {"seconds", seconds}, {"launches", launches}};
    if (const auto found = work.find(t.name); found != work.end()) {
      const Work& w = found->second;
      const double memory_s = launches * w.bytes / ceiling.bytes_s,
                   arithmetic_s = launches * w.flops / ceiling.flops_s;
      row["bytes"] = launches * w.bytes;
      row["flops"] = launches * w.flops;
      row["bound"] = memory_s > arithmetic_s ? "memory" : "arithmetic";
      row["of_limit"] = std::max(memory_s, arithmetic_s) / seconds;  // 1: at the limit
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace teletact::bench
