// Jobs that change one scene: one at a time, and whoever finds it busy holds nobody up meanwhile.
#include <gtest/gtest.h>

#include <atomic>
#include <optional>
#include <thread>

#include "service/device/look.h"
#include "service/scene/scenes.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

JobTerms of(const std::string& client) {
  JobTerms terms;
  terms.client = client;
  return terms;
}

TEST(Changing, APublicationThatFindsItsSceneBusyLendsItsTurnInsteadOfSpinning) {
  Scenes scenes("");
  const auto scene = scenes.create("s", tissue(0.12, 0.03), std::nullopt);
  const auto publish = [&](double x_m, const char* client) {
    return scenes.publish(scene, window_of(homogeneous(1e4), x_m, 0.03, 0.03), client);
  };
  // GIVEN a publication that has to make way in the midst of it
  std::atomic<bool> first_published{false};
  std::atomic<int> looks_meanwhile{0};
  std::optional<FairWorkers::Running<Published>> second;
  auto first = scenes.worker().run(of("first"), [&] {
    const Looking in_the_midst([&] {
      if (second) return;
      second = scenes.worker().run(of("second"), [&] {
        const Looking counted([&] {
          if (!first_published) ++looks_meanwhile;
        });
        return publish(0.06, "second");
      });
      // Longer than a slice: it is the other's turn now.
      std::this_thread::sleep_for(std::chrono::duration<double>(1.5 * FairQueue::kSliceS));
    });
    const Published published = publish(0.03, "first");
    first_published = true;
    return published;
  });
  // THEN the second, whose turn it is, waits without a look for the first, which goes on at once
  const Published published = first.future.get();
  ASSERT_TRUE(second);
  EXPECT_GT(second->future.get().version, published.version);
  EXPECT_EQ(looks_meanwhile, 0);
  EXPECT_EQ(scene->snapshot()->windows.size(), 2U);
}

}  // namespace
}  // namespace teletact::service
