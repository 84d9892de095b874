// What a publication owes is done while others keep the imaging plane busy without end.
#include <gtest/gtest.h>

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

TEST(Owed, NeighboursAreFreshInTimeWhileOthersNeverCease) {
  Scenes scenes("");
  const auto scene = scenes.create("s", tissue(0.12, 0.03), std::nullopt);
  std::vector<FairWorkers::Running<void>> greedy;
  for (const char* client : {"a", "b"})
    greedy.push_back(scenes.worker().run(of(client), [] {
      for (;;) {
        look();
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    }));
  std::uint64_t first = 0;
  for (const double x_m : {0.0, 0.03}) {
    const auto published = publish_into(scenes, scene, window_of(homogeneous(1e4), x_m, 0.03, 0.03), "fair");
    if (first == 0) first = published.version;
  }
  const auto version_of_first = [&] { return scene->snapshot()->windows.front()->version; };
  for (int k = 0; k < 600 && version_of_first() == first; ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_GT(version_of_first(), first);
  for (const auto& running : greedy) scenes.worker().cancel(running.id);
}

}  // namespace
}  // namespace teletact::service
