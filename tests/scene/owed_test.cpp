// What a publication owes is done while others keep the imaging plane busy without end.
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "service/device/look.h"
#include "service/scene/errors.h"
#include "service/scene/scenes.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

JobTerms of(const std::string& client) {
  JobTerms terms;
  terms.client = client;
  return terms;
}

// Time is told by what the others got of the plane, one of them at a time, in steps of a millisecond or more:
// a machine that is busy with something else makes none of it.
TEST(Owed, NeighboursAreFreshInTimeWhileOthersNeverCease) {
  std::atomic<std::int64_t> steps{0};
  Scenes scenes("");
  const auto scene = scenes.create("s", tissue(0.12, 0.03), std::nullopt);
  std::vector<FairWorkers::Running<void>> greedy;
  for (const char* client : {"a", "b"})
    greedy.push_back(scenes.worker().run(of(client), [&] {
      for (;;) {
        look();
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        ++steps;
      }
    }));
  const auto publish = [&](double x_m) {
    return publish_into(scenes, scene, window_of(homogeneous(1e4), x_m, 0.03, 0.03), "fair").version;
  };
  const std::uint64_t first = publish(0.0);
  publish(0.03);
  const std::int64_t published_at = steps;
  const auto version_of_first = [&] { return scene->snapshot()->windows.front()->version; };
  constexpr std::chrono::milliseconds kPromised = Scenes::kFreshWithin;
  while (version_of_first() == first && steps - published_at < 2 * kPromised.count())
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_GT(version_of_first(), first);
  for (const auto& running : greedy) scenes.worker().cancel(running.id);
}

}  // namespace
}  // namespace teletact::service
