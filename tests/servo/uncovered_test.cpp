// The end of what is covered, through the whole loop.
#include <gtest/gtest.h>

#include "client/render/renderers.h"
#include "client/servo/servo_loop.h"
#include "tests/render/analytic_tissue.h"
#include "tests/servo/servo_test.h"

namespace teletact::client {
namespace {

// Whatever renders: where no window covers the finger there is no force, though the link is alive.
TEST(ServoLoop, LostCoverageEndsTheForce) {
  for (const char* name : {"law", "kalman"}) {
    const auto renderer = make_renderer(name, 0.001);
    test::StillDevice device;
    ManualClock clock;
    ServoOptions options;
    options.chain.limits = device.profile().limits();
    ServoLoop servo(device, *renderer, clock, options);
    const test::AnalyticTissue tissue;
    bool covered = true;
    const auto run = [&](double y_m, double seconds) {
      device.reading.pose.position_m = Vector3(0.02, y_m, 0);
      for (int n = 0; n < 1000 * seconds; ++n) {
        ServoAnswer answer;
        answer.sample =
            tissue.told({0.02, y_m, 0}, 1e-9 * static_cast<double>(clock.time_ns), servo.ticks() + 1);
        if (!covered) answer.sample.contact = answer.sample.foreseen = false;
        if (!covered) answer.sample.force_n.setZero(), answer.sample.tangent_n_m.setZero();
        answer.covered = covered;
        answer.received_ns = clock.time_ns;
        answer.period_s = 0.002;
        servo.answers().put(answer);
        clock.time_ns += 1'000'000;
        servo.tick(clock.time_ns);
      }
    };
    run(-0.003, 0.05);
    servo.request_resume();
    run(-0.003, 0.6);
    run(0.004, 0.5);
    EXPECT_GT(device.force.norm(), 0.2) << name;
    covered = false;
    run(0.004, 0.15);
    EXPECT_EQ(device.force.norm(), 0) << name;
    ServoTick tick;
    while (servo.telemetry().pop(tick)) {
    }
    EXPECT_EQ(tick.state, ServoState::kEnabled) << name;
    EXPECT_FALSE(tick.degraded) << name;  // it is known that there is nothing
  }
}

}  // namespace
}  // namespace teletact::client
