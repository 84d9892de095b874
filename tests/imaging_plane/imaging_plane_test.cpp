// The imaging plane without its callers: what a pair that is late says of the next, and a device that fails
// when another is in use by then.
#include "service/imaging_plane/imaging_plane.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "service/device/cancellation.h"
#include "service/device/device.h"
#include "service/scene/errors.h"
#include "tests/imaging/imaging_device.h"
#include "tests/imaging/speckle.h"

namespace teletact::service {
namespace {

class Plane : public testing::Test {
 protected:
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

  const Limits limits = resolved({}, std::uint64_t{1} << 32, std::uint64_t{1} << 32);
  const EstimateRequest request = settled(limits);
  const std::vector<std::shared_ptr<Device>> opened{imaging_device()};
  std::deque<CurrentDevice> devices{opened.begin(), opened.end()};
  Scenes scenes{""};
  std::atomic<int> told{0};
  ImagingPlane plane{devices,
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

}  // namespace
}  // namespace teletact::service
