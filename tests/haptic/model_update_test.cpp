// Model updates and window hand-overs while pressed, on an injected clock: the force is continuous, and the
// energy that a new model injects is no more than was dissipated.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "client/haptic/profiles.h"
#include "client/render/force_chain.h"
#include "client/render/kalman_renderer.h"

namespace teletact::client {
namespace {

constexpr double kServoS = 0.001, kSpeedMS = 0.12, kDepthM = 0.003;

// Down, along at 120 mm/s, out again; half way along another window with another stiffness takes over.
struct HandOver {
  double before_n_m, after_n_m, update_s;
  double largest_jump = 0;                 // of the force, from tick to tick, while along
  double least_energy_j = 0, end_n_m = 0;  // port: put in less got back, friction being the display's

  static Vector2 place(double time_s) {
    const double down = std::min(time_s / 0.2, 1.0), out = std::clamp((time_s - 0.7) / 0.2, 0.0, 1.0);
    return {kSpeedMS * std::clamp(time_s - 0.2, 0.0, 0.5), kDepthM * (down - out)};
  }
  ForceSample answer(double time_s, std::uint64_t sequence) const {
    ForceSample sample;
    sample.sequence = sequence;
    sample.pose_time_s = time_s;
    sample.position_m = place(time_s);
    sample.contact = sample.position_m.y() > 0;
    const double k = time_s < 0.45 ? before_n_m : after_n_m;
    sample.force_n = {0, -k * std::max(sample.position_m.y(), 0.0)};
    if (sample.contact) sample.tangent_n_m(1, 1) = -k;
    return sample;
  }
  void run() {
    const DeviceProfile& device = device_profile("premium-1.5");
    ForceChainOptions options;
    options.limits = device.limits();
    ForceChain chain(options);
    KalmanRenderer kalman;
    double energy_j = 0, next_s = 0;
    Vector2 last_m = place(0), last_n(0, 0);
    std::uint64_t sequence = 0;
    for (int tick = 0; tick <= 950; ++tick) {
      const double time_s = kServoS * tick;
      const ToolPose pose{place(time_s), (place(time_s + kServoS) - place(time_s)) / kServoS};
      const Vector2 moved_m = pose.position_m - last_m;
      energy_j += -last_n.dot(moved_m);
      if (pose.position_m.y() > 0) energy_j += device.friction_n * moved_m.norm();
      least_energy_j = std::min(least_energy_j, energy_j);
      if (time_s >= next_s) {
        kalman.update(answer(time_s, ++sequence), pose, time_s);
        next_s += update_s;
      }
      ForceChainInput input{
          .rendered = kalman.render(pose, time_s), .pose = pose, .on = true, .enabled_s = 10};
      const Vector2 force_n = chain.apply(input).force_n;
      if (time_s > 0.25 && time_s < 0.7) {
        const double jump = (force_n - last_n).norm() / std::max(force_n.norm(), last_n.norm());
        largest_jump = std::max(largest_jump, jump);
        end_n_m = -force_n.y() / pose.position_m.y();
      }
      last_m = pose.position_m;
      last_n = force_n;
    }
  }
};

TEST(ModelUpdate, GivenAPressedFingerWhenAnotherWindowTakesOverThenTheForceJumpsByLessThanSevenPercent) {
  for (const double after_n_m : {50.0, 150.0, 190.0, 230.0, 300.0, 700.0})
    for (const double update_s : {0.002, 0.01, 0.05}) {
      HandOver handed{200, after_n_m, update_s};
      handed.run();
      EXPECT_LT(handed.largest_jump, 0.07) << after_n_m << " N/m every " << update_s << " s";
      EXPECT_NEAR(handed.end_n_m, after_n_m, 0.02 * after_n_m);  // and the new window is felt
    }
}

TEST(ModelUpdate, GivenAHarderWindowWhenTheFingerIsOutAgainThenNoMoreEnergyWasInjectedThanDissipated) {
  for (const double after_n_m : {100.0, 230.0, 300.0, 500.0})
    for (const double update_s : {0.002, 0.01, 0.05}) {
      HandOver handed{200, after_n_m, update_s};
      handed.run();
      EXPECT_GE(handed.least_energy_j, 0) << after_n_m << " N/m every " << update_s << " s";
    }
}

}  // namespace
}  // namespace teletact::client
