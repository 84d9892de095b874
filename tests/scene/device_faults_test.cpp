// A device that gives NaN, runs out of memory or no longer takes work, under a touch stream that solves on
// it: the answer says so and bears no force, and the model stays touchable through its compliance.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <string>
#include <thread>

#include "service/contact/solid_layer.h"
#include "service/device/device.h"
#include "service/touch_plane/touch_session.h"
#include "tests/scene/stacks.h"
#include "tests/scene/windows.h"
#include "tests/support/faulty_kernels.h"

namespace teletact::service {
namespace {

class FaultyDevice : public FaultyKernels {
 protected:
  static constexpr double kDepthM = 0.300;  // so many nodes that multigrid preconditions

  void SetUp() override {
    FaultyKernels::SetUp();
    scene_ = scene_of_depth(kDepthM);
  }

  // Presses by way of the device, again and again, and by compliance beside it. `of_device`: it is the device
  // that failed, and not what was asked of it.
  void expect_failure(const std::string& why, bool of_device = false) {
    TouchSession by_compliance(scene_, {}, nullptr);
    const double force = by_compliance.solve({0.06, 0.003}).contact.force_n[1];
    EXPECT_LT(force, 0);
    TouchOptions touch;
    touch.path = SolvePath::kGradients;
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
  static std::shared_ptr<Scene> solid(double hard_pa) {
    constexpr std::size_t kElements = 16;  // along each side
    ExplicitModulus e{uniform_coordinates(0, 0.048, kElements), uniform_coordinates(0, 0.03, kElements), {}};
    e.z_m = uniform_coordinates(-0.024, 0.024, kElements);
    for (std::size_t n = 0; n < kElements * kElements * kElements; ++n)
      e.youngs_modulus_pa.push_back(n % kElements < kElements / 2 ? 1e4 : hard_pa);
    return std::make_shared<Scene>("s", tissue(0.048, 0.03), e, versions(), Limits{}, MemoryAccount{},
                                   tissue_models());
  }
  // Whatever answers until its correction has failed (on a machine that never ran them its kernels are
  // compiled first, for seconds) is DEGRADED.
  void expect_failing_solid(const std::string& why) {
    TouchSession session(solid(5e4), {}, Device::open(options_));
    const auto late = [&] {
      const TouchAnswer answer = session.solve({0.024, 0.002, 0});
      EXPECT_NE(answer.status, TouchStatus::kOk);
      return answer.warning.find(kLateReason) != std::string::npos;
    };
    for (int tries = 0; tries < 1000 && late();) ++tries;
    for (int k = 0; k < 2; ++k) {
      const TouchAnswer answer = session.solve({0.024, 0.002, 0});
      EXPECT_EQ(answer.status, TouchStatus::kFailed);
      EXPECT_NE(answer.warning.find(why), std::string::npos) << answer.warning;
      EXPECT_EQ(answer.contact.force_n, Vector3{});
      EXPECT_FALSE(answer.device_failed) << "it takes work";
    }
  }

  // On which a step of a correction takes a tenth of a second or more, or as much longer.
  std::shared_ptr<Device> slow_device(int times = 1) {
    sabotage("solid.cl", "  STORE(LOAD(u + at) + alpha",
             "  for (volatile int n = 0; n < " + std::to_string(20000 * times) +
                 "; ++n) {}\n  STORE(LOAD(u + at) + alpha");
    return Device::open(options_);
  }
  // To and fro over where the modulus changes.
  static Vector3 at(double way) { return {0.024 + 0.008 * std::sin(way), 0.002, 0}; }
  // It is put down until it is corrected.
  static TouchAnswer put_down(TouchSession& finger) {
    TouchAnswer answer = finger.solve(at(0));
    for (int tries = 0; tries < 600 && answer.status != TouchStatus::kOk; ++tries) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));  // leaves the correction a core
      answer = finger.solve(at(0));
    }
    EXPECT_EQ(answer.status, TouchStatus::kOk) << answer.warning;
    return answer;
  }

  static std::shared_ptr<Scene> scene_of_depth(double depth_m) {
    auto scene = std::make_shared<Scene>("s", tissue(0.12, depth_m), versions());
    scene->publish(window_of(homogeneous(10e3), 0.03, 0.06, depth_m));
    return scene;
  }

  std::shared_ptr<Scene> scene_;
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
  options_.max_array_bytes = 10000;
  expect_failure("exceeds the 10000 that");
}

TEST_F(FaultyDevice, DeviceThatTakesNoMoreWorkIsSaid) {
  // A kernel that insists on another work-group size: enqueueing it fails, as on a device that is lost.
  sabotage("pcg.cl", "kernel void pcg_update",
           "kernel __attribute__((reqd_work_group_size(7, 1, 1))) void pcg_update");
  expect_failure("launch of kernel pcg_update", true);
}

TEST_F(FaultyDevice, ANarrowWindowSaysSoToo) {
  scene_ = scene_of_depth(0.03);
  sabotage("block_tridiagonal.cl", "  return alpha;", "  return alpha * (real)NAN;");
  expect_failure("no usable solution");
}

TEST_F(FaultyDevice, NanInASolidIsSaid) {
  sabotage("solid.cl", "STORE(LOAD(u + at) + alpha", "STORE((real)NAN * LOAD(u + at) + alpha");
  expect_failing_solid("not finite");
}

// By the nodes: shares, once they are learned, would answer in their place.
TEST_F(FaultyDevice, SlowOneKeepsNoFingerWaiting) {
  TouchSession finger(solid(3e4), {.fingertip = {}, .path = SolvePath::kGradients}, slow_device());
  put_down(finger);
  std::size_t meanwhile = 0, corrected = 0;
  for (double way = 0; corrected < 3 && way < 60; way += 0.002) {
    const TouchAnswer answer = finger.solve(at(way));
    meanwhile += answer.status == TouchStatus::kOk && answer.contact.solve.improving;
    corrected += answer.contact.solve.iterations > 0;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_EQ(corrected, 3u);
  EXPECT_GT(meanwhile, 20 * corrected) << "answers that wait for a correction are as good as is asked";
}

// GIVEN a hard half beside a soft one, which shares are far off at, WHEN the nodes' correction takes long,
// THEN what answers meanwhile is DEGRADED and says why, and what is OK is right.
TEST_F(FaultyDevice, HoweverSlowItIsSharesInTheNodesPlaceAreDegraded) {
  TouchSession exact(solid(5e4), {.fingertip = {}, .path = SolvePath::kGradients}, Device::open());
  const double truth = put_down(exact).contact.force_n[1];
  std::size_t late = 0;
  // Slower and slower, until the finger, which a busy machine holds up too, asks before it is corrected.
  for (int times = 4; late == 0 && times <= 256; times *= 4) {
    TouchSession finger(solid(5e4), {}, slow_device(times));
    bool by_nodes = false;
    for (int tries = 0; tries < 20000 && !by_nodes; ++tries) {
      const TouchAnswer answer = finger.solve(at(0));
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      by_nodes = answer.status == TouchStatus::kOk && answer.contact.path == SolvePath::kGradients;
      const double off = std::abs(answer.contact.force_n[1] / truth - 1);
      if (answer.status == TouchStatus::kOk) {
        EXPECT_LT(off, choices::kTrustedMeanwhile) << answer.warning;
      }
      if (answer.contact.path != SolvePath::kShares) continue;
      ++late;
      EXPECT_EQ(answer.status, TouchStatus::kDegraded) << off;
      EXPECT_NE(answer.warning.find(kLateReason), std::string::npos) << answer.warning;
    }
    ASSERT_TRUE(by_nodes);
  }
  EXPECT_GT(late, 0u);
}

// On a worn factor (T8.7) corrections do not settle: what is known well enough is told when the time is up.
// By the nodes: shares, once they are learned, need no factor.
TEST_F(FaultyDevice, HoweverSlowItIsAWornSolidIsAnswered) {
  const auto scene = scene_of(stack({-0.01}));
  TouchSession finger(scene, {.fingertip = {}, .path = SolvePath::kGradients}, slow_device());
  const auto touched = [&] {
    TouchAnswer answer;
    answer.status = TouchStatus::kFailed;
    for (int tries = 0; tries < 50 && answer.status == TouchStatus::kFailed; ++tries)
      answer = finger.solve({kBallX, 0.002, 0.001});
    return answer;
  };
  EXPECT_LT(touched().contact.force_n[1], 0);
  ModulusSlice slice = slice_at(0.01);
  for (double& e : slice.youngs_modulus_pa) e *= 4;
  for (std::size_t n = 24 * 5; n < 24 * 10; ++n) slice.youngs_modulus_pa[n] *= 6;
  scene->publish(slice);
  const TouchAnswer worn = touched();
  EXPECT_EQ(worn.status, TouchStatus::kDegraded);
  EXPECT_NE(worn.warning.find("layers changed"), std::string::npos) << worn.warning;
}

TEST_F(FaultyDevice, IsReplacedAmidACorrection) {
  const TouchOptions by_nodes{.fingertip = {}, .path = SolvePath::kGradients};
  TouchSession finger(solid(1.5e4), by_nodes, slow_device());
  put_down(finger);
  TouchAnswer answer = finger.solve(at(0.1));  // it is corrected where it has come to
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  fail_launches(true);
  for (double way = 0.1; answer.status != TouchStatus::kFailed && way < 60; way += 0.002) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    answer = finger.solve(at(way));
  }
  fail_launches(false);
  EXPECT_EQ(answer.status, TouchStatus::kFailed);
  EXPECT_TRUE(answer.device_failed);
  EXPECT_NE(answer.warning.find("launch of kernel"), std::string::npos) << answer.warning;
  EXPECT_EQ(answer.contact.force_n, Vector3{});
  finger.use(Device::open());
  answer = put_down(finger);
  TouchSession fresh(solid(1.5e4), by_nodes, Device::open());
  const double truth = fresh.solve(at(0)).contact.force_n[1];
  EXPECT_NEAR(answer.contact.force_n[1], truth, 2 * choices::kSolidForceError * -truth);
}

TEST_F(FaultyDevice, SolidWithoutRoomIsSaid) {
  options_.max_array_bytes = 10000;
  expect_failing_solid("exceeds the 10000 that");
}

}  // namespace
}  // namespace teletact::service
