// Publications and what they owe: jobs that change one scene one at a time, and neighbours that are fresh in
// time.
#include "service/imaging_plane/publisher.h"

#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <future>
#include <optional>
#include <thread>

#include "service/device/cancellation.h"
#include "service/scene/errors.h"
#include "tests/scene/create_scene.h"
#include "tests/scene/stacks.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

class Publishing : public testing::Test {
 protected:
  ~Publishing() override { workers.stop(); }
  static JobTerms of(const std::string& client, std::size_t device = 0) {
    JobTerms terms;
    terms.client = client;
    terms.device = device;
    return terms;
  }
  Published publish(double x_m, const char* client) {
    return publisher.publish(scene, window_of(homogeneous(1e4), x_m, 0.03, 0.03), client);
  }
  // Has a publication begun, which changes the scene until `release`.
  auto held_in_the_midst(const std::function<Published()>& publication) {
    auto held = workers.run(of("first"), [this, publication] {
      const CancellationCheck waits([this] {
        in_the_midst = true;
        while (!release) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      });
      return publication();
    });
    while (!in_the_midst) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return held;
  }
  std::atomic<bool> in_the_midst{false}, release{false};
  Scenes scenes{""};
  const std::shared_ptr<Scene> scene = create_scene(scenes, "s", tissue(0.12, 0.03), std::nullopt);
  Workers workers;
  Publisher publisher{scenes, workers};
};

TEST_F(Publishing, IsRefusedOnAThreadThatIsNoWorker) {
  EXPECT_THROW(publish(0.03, "anybody"), std::logic_error);
  EXPECT_TRUE(scene->snapshot()->windows.empty());
}

// A scene that was moved to another device while the former one's job was about to publish.
TEST_F(Publishing, WaitsForAnotherDevicesChange) {
  std::atomic<bool> second_done{false};
  auto first = held_in_the_midst([&] { return publish(0.03, "first"); });
  std::atomic<bool> second_begun{false};
  auto second = workers.run(of("second", 1), [&] {
    second_begun = true;
    const Published published = publish(0.06, "second");
    second_done = true;
    return published;
  });
  while (!second_begun) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  // Its device does not wait with it.
  workers.run(of("third", 1), [] {}).future.get();
  EXPECT_FALSE(second_done);
  release = true;
  EXPECT_LT(first.future.get().version, second.future.get().version);
  EXPECT_EQ(scene->snapshot()->windows.size(), 2U);
}

TEST_F(Publishing, GivesUpBehindADeviceThatHangs) {
  Publisher impatient{scenes, workers, std::chrono::milliseconds(50)};
  const auto publish_at = [&](double x_m, const char* client) {
    return impatient.publish(scene, window_of(homogeneous(1e4), x_m, 0.03, 0.03), client);
  };
  auto hangs = held_in_the_midst([&] { return publish_at(0.03, "first"); });
  auto given_up = workers.run(of("second", 1), [&] { return publish_at(0.06, "second"); });
  try {
    given_up.future.get();
    ADD_FAILURE() << "published beside another change";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind, ErrorKind::kUnavailable);
  }
  release = true;
  hangs.future.get();
  EXPECT_EQ(scene->snapshot()->windows.size(), 1U);
}

TEST_F(Publishing, NeighboursAreFreshThoughTheFormerDeviceHangs) {
  std::promise<std::uint64_t> published;
  std::promise<void> release;
  auto hangs = workers.run(of("first"), [&] {  // and so does the refresh that it owes
    const std::uint64_t first = publish(0.0, "first").version;
    publish(0.03, "first");
    published.set_value(first);
    release.get_future().wait();
  });
  const std::uint64_t first = published.get_future().get();
  workers.run(of("second", 1), [&] { publish(0.06, "second"); }).future.get();
  const auto fresh = [&] { return scene->snapshot()->windows.front()->version > first; };
  for (int k = 0; k < 60'000 && !fresh(); ++k) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_TRUE(fresh());
  release.set_value();
  hangs.future.get();
}

TEST_F(Publishing, LendsItsTurnWhileTheSceneIsBusy) {
  // GIVEN a publication that has to make way in the midst of it
  std::atomic<bool> first_published{false};
  std::atomic<int> looks_meanwhile{0};
  std::optional<Workers::Running<Published>> second;
  auto first = workers.run(of("first"), [&] {
    const CancellationCheck in_the_midst([&] {
      if (second) return;
      second = workers.run(of("second"), [&] {
        const CancellationCheck counted([&] {
          if (!first_published) ++looks_meanwhile;
        });
        return publish(0.06, "second");
      });
      // Longer than a slice: it is the other's turn now.
      std::this_thread::sleep_for(std::chrono::duration<double>(1.5 * Schedule::kSliceS));
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

// Time is told by what the others got of the plane, one of them at a time, in steps of a millisecond or more:
// a machine that is busy with something else makes none of it.
TEST_F(Publishing, NeighboursAreFreshInTimeWhileOthersNeverCease) {
  std::atomic<std::int64_t> steps{0};
  std::vector<Workers::Running<void>> greedy;
  for (const char* client : {"a", "b"})
    greedy.push_back(workers.run(of(client), [&] {
      for (;;) {
        check_cancelled();
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        ++steps;
      }
    }));
  const auto publish_fairly = [&](double x_m) {
    return workers.run(of("fair"), [&] { return publish(x_m, "fair"); }).future.get().version;
  };
  const std::uint64_t first = publish_fairly(0.0);
  publish_fairly(0.03);
  const std::int64_t published_at = steps;
  const auto version_of_first = [&] { return scene->snapshot()->windows.front()->version; };
  constexpr std::chrono::milliseconds kPromised = Publisher::kFreshWithin;
  while (version_of_first() == first && steps - published_at < 2 * kPromised.count())
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_GT(version_of_first(), first);
  for (auto& running : greedy) {
    workers.cancel(running.id);
    running.future.wait();  // it counts steps
  }
}

// Worn by every slice, and renewed by one that nothing wears.
class WornModel final : public TouchModel {
 public:
  explicit WornModel(bool renewed = false) : renewed_(renewed) {}
  Region region() const override { return {0, kWidthM, RangeZ{-0.018, 0.018}}; }
  std::vector<Layer> layers() const override { return {Layer{}}; }
  std::shared_ptr<TouchedLayer> layer(const Layer&, const TouchWay&, const TouchWork&) const override {
    return nullptr;
  }
  std::shared_ptr<const TouchModel> renewed(const MemoryAccount&) const override {
    return renewed_ ? nullptr : std::make_shared<WornModel>(true);
  }

 private:
  const bool renewed_;
};
class WornModels final : public TouchModels {
 public:
  std::vector<Layer> layers(const SceneGeometry&) const override { return {Layer{}}; }
  double context_m() const override { return 0; }
  std::shared_ptr<const TouchModel> of_window(const WantedModel&) const override { return nullptr; }
  std::shared_ptr<const TouchModel> of_modulus(const SceneGeometry&, const ExplicitModulus&,
                                               const MemoryAccount&) const override {
    return std::make_shared<WornModel>();
  }
};

// Nobody waits for a window's neighbours so long, and for the next slice somebody does.
TEST(PublishingSlices, AWornModelIsRenewedOnceNobodyAsks) {
  Scenes solids("", {}, machine_files(), {}, std::make_shared<WornModels>());
  Workers workers;
  Publisher publisher(solids, workers);
  const auto scene = create_scene(solids, "s", tissue(kWidthM, kDepthM), stack({-0.01}));
  std::uint64_t published = 0;
  auto estimate = [&] {
    published = publisher.publish(scene, slice_at(0.01), "patient").version;
    for (std::chrono::milliseconds had{0}; had < 1.2 * Publisher::kFreshWithin;
         had += std::chrono::milliseconds(1)) {
      check_cancelled();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return scene->snapshot()->version;
  };
  EXPECT_EQ(workers.run({.client = "patient"}, estimate).future.get(), published);
  workers.finish();
  EXPECT_GT(scene->snapshot()->version, published);
}

}  // namespace
}  // namespace teletact::service
