// The imaging plane without its callers: what a pair that is late says of the next, a device that fails when
// another is in use by then, and pairs that one device works on at once.
#include "service/imaging_plane/imaging_plane.h"

#include <gtest/gtest.h>

#include <atomic>
#include <latch>
#include <map>
#include <thread>

#include "service/device/cancellation.h"
#include "service/device/device.h"
#include "service/scene/errors.h"
#include "tests/imaging/imaging_device.h"
#include "tests/imaging/speckle.h"
#include "tests/scene/create_scene.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

class Plane : public testing::Test {
 protected:
  explicit Plane(std::size_t at_once_ = 1) : at_once(at_once_) {}
  using Frames = std::pair<RfFrame, RfFrame>;
  static Frames frames() {
    static const Speckle speckle{SpeckleOptions()};
    const auto moved = [](double strain) {
      return [strain](double, double y_m) { return std::pair{0.0, strain * y_m}; };
    };
    return {speckle.frame(moved(0), 1), speckle.frame(moved(-0.01), 2)};
  }
  static EstimateRequest settled(const Limits& limits) {
    EstimateRequest request;
    request.sample_count = SpeckleOptions().samples, request.line_count = SpeckleOptions().lines;
    request.geometry = speckle_geometry();
    request.modulus.kind = ModulusKind::kReferenceStress;
    settle(request, limits);
    return request;
  }
  void estimate(const std::function<Frames()>& unpack, const std::function<void(Stage)>& ended,
                Workers::Clock::duration within = std::chrono::minutes(5)) {
    JobTerms terms;
    terms.deadline = Workers::Clock::now() + within;
    plane.workers()
        .run(terms, [&] { lane.estimate(request, {}, Workers::Clock::now(), unpack, ended); })
        .future.get();
  }
  double expected_s() { return lane.admit(request, {}).cost_s; }

  const std::size_t at_once;
  const Limits limits = resolved({}, std::uint64_t{1} << 32, std::uint64_t{1} << 32);
  const EstimateRequest request = settled(limits);
  const std::vector<std::shared_ptr<Device>> opened{imaging_device()};
  std::deque<CurrentDevice> devices{opened.begin(), opened.end()};
  Scenes scenes{""};
  std::atomic<int> told{0};
  ImagingPlane plane{devices,
                     at_once,
                     scenes,
                     std::make_shared<MemoryBudget>(limits),
                     tissue_models(),
                     [](std::size_t) { return Device::open(); },
                     [this](bool) { ++told; }};
  ImagingLane& lane = plane.lanes().front();
};

// What is expected of an estimate falls while none is done; one that was tried and is late ends that.
TEST_F(Plane, OneThatIsLateBeforeItsFramesAreReadWasNotTried) {
  const double before_s = expected_s();
  const auto endless = []() -> Frames {
    for (;; std::this_thread::sleep_for(std::chrono::milliseconds(1))) check_cancelled();
  };
  EXPECT_THROW(estimate(endless, {}, std::chrono::milliseconds(100)), Error);
  const double unread_s = expected_s();
  EXPECT_LT(unread_s, before_s);
  EXPECT_THROW(estimate(frames, [](Stage) { throw Error(ErrorKind::kDeadline, "late"); }), Error);
  EXPECT_GT(expected_s(), unread_s);
}

TEST_F(Plane, FailureOfAReplacedDeviceIsNotTheNewOnes) {
  const auto replaced = [&](Stage) {
    devices.front().replace(Device::open());
    fail_launches(true);
  };
  try {
    estimate(frames, replaced);
    ADD_FAILURE() << "the launches did not fail";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind, ErrorKind::kUnavailable) << error.what();
  }
  fail_launches(false);
  EXPECT_NO_THROW(plane.require_device());
  EXPECT_NO_THROW(estimate(frames, {}));
  EXPECT_EQ(told, 0);
}

TEST(UsualAtOnce, AGpuHasAPairACoreButOneAndAProcessorOneForTwo) {
  DeviceInfo device;
  device.compute_units = 64;
  for (const auto& [cores, pairs] : std::map<std::size_t, std::size_t>{{0, 1}, {2, 1}, {8, 4}, {64, 16}})
    EXPECT_EQ(usual_at_once(device, cores), pairs) << cores;
  device.compute_units = 4;
  EXPECT_EQ(usual_at_once(device, 64), 2U) << "a part of it";
  device.gpu = true;
  for (const auto& [cores, pairs] :
       std::map<std::size_t, std::size_t>{{0, 1}, {2, 1}, {8, 7}, {17, 16}, {64, 16}})
    EXPECT_EQ(usual_at_once(device, cores), pairs) << cores;
}

class AtOnce : public Plane {
 protected:
  AtOnce() : Plane(2) {}
  // On the turns that it is given.
  Workers::Running<Estimate> begin(const EstimateRequest& of, const std::function<Frames()>& unpack) {
    JobTerms terms;
    ImagingLane& at = plane.lane_for(of, terms);
    terms = at.admit(of, terms);
    return plane.workers().run(terms, [this, &at, of, terms, unpack] {
      return at.estimate(of, terms, Workers::Clock::now(), unpack, {}).estimate;
    });
  }
  // Each goes on only when the other has begun.
  static Frames met(std::latch& both) {
    const auto late = Workers::Clock::now() + std::chrono::minutes(1);
    both.count_down();
    while (!both.try_wait() && Workers::Clock::now() < late)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    EXPECT_TRUE(both.try_wait()) << "the other one waits for this one's end";
    return frames();
  }
  static Field map(const Estimate& e) {
    EXPECT_GT(e.valid_fraction, 0.5);
    Field out = e.modulus.youngs_modulus;
    for (std::size_t n = 0; n < out.size(); ++n)
      if (!e.valid[n]) out[n] = 0;  // NaN, which equals nothing
    return out;
  }
  std::shared_ptr<Scene> scene(const char* id) {
    return create_scene(scenes, id, tissue(0.05, 0.02), std::nullopt);
  }
  EstimateRequest slice_of(const std::shared_ptr<Scene>& of) {
    EstimateRequest out = request;
    out.slice_of = {of, 0, 0};
    return out;
  }
};

// Both find what one alone finds.
TEST_F(AtOnce, TwoPairsAreWorkedOnSideBySide) {
  std::latch both(2);
  auto first = begin(request, [&] { return met(both); }), second = begin(request, [&] { return met(both); });
  const Field a = map(first.future.get()), b = map(second.future.get()),
              alone = map(begin(request, frames).future.get());
  EXPECT_EQ(a, alone);
  EXPECT_EQ(b, alone);
}

TEST_F(AtOnce, ADeviceThatFailsUnderBothComesBackForBoth) {
  const Field before = map(begin(request, frames).future.get());
  const struct Reset {
    ~Reset() { fail_launches(false); }
  } reset;
  std::latch both(2), again(2);
  const auto failing = [&] {
    const Frames frames = met(both);
    fail_launches(true);
    return frames;
  };
  auto first = begin(request, failing), second = begin(request, failing);
  for (auto* pair : {&first, &second}) try {
      pair->future.get();
      ADD_FAILURE() << "the launches did not fail";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind, ErrorKind::kUnavailable) << error.what();
    }
  fail_launches(false);
  const auto late = Workers::Clock::now() + std::chrono::minutes(5);  // it is compiled for
  while (lane.failed() && Workers::Clock::now() < late)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  auto third = begin(request, [&] { return met(again); }),
       fourth = begin(request, [&] { return met(again); });
  EXPECT_EQ(map(third.future.get()), before);
  EXPECT_EQ(map(fourth.future.get()), before);
}

// What a scene's pair tells is known to its next one.
TEST_F(AtOnce, PairsOfOneSceneAreWorkedOnOneByOne) {
  const auto a = scene("a"), b = scene("b");
  const auto turns_of = [&](const std::shared_ptr<Scene>& of) {
    JobTerms terms;
    plane.lane_for(slice_of(of), terms);
    return terms.device;
  };
  EXPECT_EQ(turns_of(a), turns_of(a));
  EXPECT_NE(turns_of(a), turns_of(b));
  EXPECT_EQ(turns_of(b), turns_of(b));
}

}  // namespace
}  // namespace teletact::service
