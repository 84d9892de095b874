// A device that gives NaN, runs out of memory or no longer takes work, under a touch stream that solves on
// it: the answer says so and bears no force, and the model stays touchable through its compliance.
#include <gtest/gtest.h>

#include <string>

#include "service/touch_plane/touch_session.h"
#include "tests/scene/windows.h"
#include "tests/support/faulty_kernels.h"

namespace teletact::service {
namespace {

class FaultyDevice : public FaultyKernels {
 protected:
  void SetUp() override {
    FaultyKernels::SetUp();
    scene_->publish(window_of(homogeneous(10e3), 0.03, 0.06, 0.03), {});
  }

  // Presses by way of the device, again and again, and by compliance beside it. `of_device`: it is the device
  // that failed, and not what was asked of it.
  void expect_failure(const std::string& why, bool of_device = false) {
    TouchSession by_compliance(scene_, {}, nullptr);
    const double force = by_compliance.solve({0.06, 0.003}).contact.force_n[1];
    EXPECT_LT(force, 0);
    TouchOptions touch;
    touch.path = SolvePath::kPcg;
    TouchSession by_device(scene_, touch, Device::open(options_));
    for (int k = 0; k < 2; ++k) {  // a failed set-up is tried again
      const TouchAnswer answer = by_device.solve({0.06, 0.003});
      EXPECT_EQ(answer.status, TouchStatus::kFailed);
      EXPECT_NE(answer.warning.find(why), std::string::npos) << answer.warning;
      EXPECT_EQ(answer.contact.force_n[1], 0);
      EXPECT_EQ(answer.device_failed, of_device);
      const TouchAnswer beside = by_compliance.solve({0.06, 0.003});
      EXPECT_EQ(beside.status, TouchStatus::kOk);
      EXPECT_EQ(beside.contact.force_n[1], force);
    }
  }

  // A solid whose modulus changes along x, so that its contact is solved on the device.
  void expect_failing_solid(const std::string& why) {
    constexpr std::size_t kElements = 16;  // along each side
    ExplicitModulus e{uniform_coordinates(0, 0.048, kElements), uniform_coordinates(0, 0.03, kElements), {}};
    e.z_m = uniform_coordinates(-0.024, 0.024, kElements);
    for (std::size_t n = 0; n < kElements * kElements * kElements; ++n)
      e.youngs_modulus_pa.push_back(n % kElements < kElements / 2 ? 1e4 : 5e4);
    const auto solid = std::make_shared<Scene>("s", tissue(0.048, 0.03), e, versions(), Limits{},
                                               MemoryAccount{}, plane_models());
    TouchSession session(solid, {}, Device::open(options_));
    for (int k = 0; k < 2; ++k) {
      const TouchAnswer answer = session.solve({0.024, 0.002, 0});
      EXPECT_EQ(answer.status, TouchStatus::kFailed);
      EXPECT_NE(answer.warning.find(why), std::string::npos) << answer.warning;
      EXPECT_EQ(answer.contact.force_n, Vector3{});
      EXPECT_FALSE(answer.device_failed) << "it takes work";
    }
  }

  std::shared_ptr<Scene> scene_ = std::make_shared<Scene>("s", tissue(0.12, 0.03), versions());
};

TEST_F(FaultyDevice, NanFromTheOperatorIsSaid) {
  sabotage("elasticity.cl", "is_free * force +", "is_free * force * (real)NAN +");
  expect_failure("not finite");
}

TEST_F(FaultyDevice, NanInTheStiffnessIsSaid) {
  sabotage("elasticity.cl", "  stencil[", "  sum = sum * (real)NAN;\n  stencil[");
  expect_failure("not symmetric positive definite");
}

TEST_F(FaultyDevice, OutOfMemoryIsSaid) {
  options_.most_array_bytes = 10000;
  expect_failure("exceeds the 10000 that");
}

TEST_F(FaultyDevice, DeviceThatTakesNoMoreWorkIsSaid) {
  // A kernel that insists on another work-group size: enqueueing it fails, as on a device that is lost.
  sabotage("pcg.cl", "kernel void pcg_update",
           "kernel __attribute__((reqd_work_group_size(7, 1, 1))) void pcg_update");
  expect_failure("launch of kernel pcg_update", true);
}

TEST_F(FaultyDevice, NanInASolidIsSaid) {
  sabotage("solid.cl", "STORE(LOAD(u + at) + alpha", "STORE((real)NAN * LOAD(u + at) + alpha");
  expect_failing_solid("not finite");
}

TEST_F(FaultyDevice, SolidWithoutRoomIsSaid) {
  options_.most_array_bytes = 10000;
  expect_failing_solid("exceeds the 10000 that");
}

}  // namespace
}  // namespace teletact::service
