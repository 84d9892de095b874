#include "client/servo/servo_loop.h"

#include <gtest/gtest.h>

#include <limits>
#include <memory>

#include "client/haptic/simulated_device.h"
#include "client/servo/tick_statistics.h"
#include "tests/servo/servo_test.h"
#include "tests/support/allocation/allocation_count.h"

namespace teletact::client {
namespace {

using test::ServoTest;

TEST_F(ServoTest, StartsDisabledAndWithoutForce) {
  put_finger(0.004);
  run(0.2);
  EXPECT_EQ(last.state, ServoState::kDisabled);
  EXPECT_EQ(device.force.norm(), 0);
}

TEST_F(ServoTest, IsEnabledOnlyOutOfContactAndForgetsTheWish) {
  put_finger(0.004);
  run(0.05);
  servo->request_resume();
  run(0.05);
  EXPECT_EQ(last.state, ServoState::kDisabled);
  put_finger(-0.003);  // a wish not granted is not kept
  run(0.05);
  EXPECT_EQ(last.state, ServoState::kDisabled);
  enable();
}

TEST_F(ServoTest, IsNotEnabledWithoutAnswersAndSaysSo) {
  silent = true;
  put_finger(-0.003);
  servo->request_resume();
  run(0.001);
  EXPECT_STREQ(last.resume_refused, "no answer comes from the service");
  run(0.1);
  EXPECT_EQ(last.state, ServoState::kDisabled);
  EXPECT_EQ(last.resume_refused, nullptr);
}

TEST_F(ServoTest, RendersTheTissueAfterTheRamp) {
  enable();
  put_finger(0.004);
  run(1);
  const Vector3 truth = tissue.answer({0.02, 0.004, 0}).force_n;
  EXPECT_LE((device.force - truth).norm(), 0.01 * truth.norm());
  EXPECT_GT(truth.norm(), 0.5);
}

TEST_F(ServoTest, SilenceFadesToZeroWithin150Milliseconds) {
  // GIVEN a finger pressed, WHEN the service dies
  enable();
  put_finger(0.004);
  run(1);
  const double pressed_n = device.force.norm();
  silent = true;
  largest_step_n = 0;
  // THEN the force is whole for 50 ms, zero after 150 ms, without a step, and the state says why
  run(0.045);
  EXPECT_NEAR(device.force.norm(), pressed_n, 1e-3 * pressed_n);
  run(0.05);
  EXPECT_LT(device.force.norm(), 0.7 * pressed_n);
  EXPECT_EQ(last.state, ServoState::kEnabled);
  run(0.057);
  EXPECT_EQ(device.force.norm(), 0);
  EXPECT_EQ(last.state, ServoState::kPaused);
  EXPECT_EQ(last.reason, StateReason::kSilence);
  EXPECT_LE(largest_step_n, options.chain.limits.largest_slew_n_s * 0.001 + 1e-12);
}

TEST_F(ServoTest, ForceReturnsOnlyWhenResumedOutOfContact) {
  enable();
  put_finger(0.004);
  run(1);
  silent = true;
  run(0.3);
  // GIVEN answers again while the finger is still in the tissue
  silent = false;
  run(0.5);
  EXPECT_EQ(device.force.norm(), 0);
  servo->request_resume();
  run(0.1);
  EXPECT_EQ(last.state, ServoState::kPaused);
  EXPECT_EQ(device.force.norm(), 0);
  // WHEN it is lifted and the operator resumes THEN force comes back, with the ramp
  put_finger(-0.003);
  run(0.1);
  EXPECT_EQ(last.state, ServoState::kPaused);
  servo->request_resume();
  run(0.01);
  EXPECT_EQ(last.state, ServoState::kEnabled);
  put_finger(0.004);
  run(0.1);
  const double ramping_n = device.force.norm();
  run(1);
  EXPECT_LT(ramping_n, 0.4 * device.force.norm());
  EXPECT_GT(device.force.norm(), 0.5);
}

TEST_F(ServoTest, ADeviceThatIsReadButTakesNoForceIsLost) {
  enable();
  EXPECT_TRUE(last.device_ok);
  device.takes_force = false;
  run(0.001);
  EXPECT_EQ(last.state, ServoState::kFault);
  EXPECT_EQ(last.reason, StateReason::kDeviceLost);
  EXPECT_FALSE(last.device_ok);
}

TEST_F(ServoTest, RunawayIsAFaultAndSlewsToZero) {
  enable();
  put_finger(0.004);
  run(1);
  largest_step_n = 0;
  device.reading.pose.velocity_m_s = Vector3(3, 0, 0);
  run(0.1);
  EXPECT_EQ(last.state, ServoState::kFault);
  EXPECT_EQ(last.reason, StateReason::kTooFast);
  EXPECT_EQ(device.force.norm(), 0);
  EXPECT_LE(largest_step_n, options.chain.limits.largest_slew_n_s * 0.001 + 1e-12);
}

TEST_F(ServoTest, BadAnswersAreRejectedAndDoNotCountAsLife) {
  enable();
  put_finger(0.004);
  run(1);
  silent = true;
  for (int n = 0; n < 300; ++n) {
    ServoAnswer answer;
    answer.received_ns = clock.time_ns;
    answer.sample =
        tissue.answer({0.02, 0.004, 0}, 1e-9 * static_cast<double>(clock.time_ns), sequence + 1 + n);
    if (n % 3 == 0) answer.sample.force_n.x() = NAN;
    if (n % 3 == 1) answer.sample.sequence = 1;        // out of order
    if (n % 3 == 2) answer.sample.pose_time_s += 100;  // of the future
    servo->answers().put(answer);
    run(0.001);
  }
  EXPECT_EQ(servo->rejected_answers(), 300u);
  EXPECT_EQ(last.state, ServoState::kPaused);
  EXPECT_EQ(device.force.norm(), 0);
}

TEST_F(ServoTest, DoubtedAnswerIsFeltAndSaidInEveryTick) {
  enable();
  put_finger(0.004);
  run(1);
  const Vector3 trusted_n = device.force;
  EXPECT_FALSE(last.service_degraded);
  service_degraded = true;
  run(0.1);
  EXPECT_TRUE(last.service_degraded);
  EXPECT_FALSE(last.degraded);
  EXPECT_LE((device.force - trusted_n).norm(), 1e-6);
  EXPECT_GT(device.force.norm(), 0.5);
  service_degraded = false;
  run(0.01);
  EXPECT_FALSE(last.service_degraded);
}

TEST_F(ServoTest, TissueIsFeltAgainAfterAPositionWithoutANumber) {
  enable();
  put_finger(0.004);
  run(1);
  // WHEN the device gives no numbers for a moment THEN it is a fault, and neither model nor link sees them
  put_finger(NAN);
  run(0.012);
  EXPECT_EQ(last.state, ServoState::kFault);
  EXPECT_EQ(last.reason, StateReason::kNotFinite);
  EXPECT_TRUE(last.pose.position_m.allFinite());
  put_finger(0.004);
  run(0.1);
  EXPECT_EQ(device.force.norm(), 0);
  EXPECT_LE(largest_step_n, options.chain.limits.largest_slew_n_s * 0.001 + 1e-12);
  // and after lifting and resuming everything is as before
  enable();
  put_finger(0.004);
  run(1);
  const Vector3 truth = tissue.answer({0.02, 0.004, 0}).force_n;
  EXPECT_LE((device.force - truth).norm(), 0.01 * truth.norm());
}

// Gives what the Kalman filter gives, but no number while `broken`.
class BreakingRenderer final : public Renderer {
 public:
  void reset() noexcept override { good_.reset(); }
  bool update(const ForceSample& sample, const ToolPose& pose, double time_s) noexcept override {
    return good_.update(sample, pose, time_s);
  }
  Rendered render(const ToolPose& pose, double time_s, EnergyLedger& ledger) noexcept override {
    Rendered rendered = good_.render(pose, time_s, ledger);
    if (broken) rendered.force_n.y() = std::numeric_limits<double>::quiet_NaN();
    return rendered;
  }
  bool broken = false;

 private:
  KalmanRenderer good_;
};

TEST_F(ServoTest, RendererWithoutANumberIsAFaultUntilResumed) {
  BreakingRenderer breaking;
  servo = std::make_unique<ServoLoop>(device, breaking, clock, options);
  enable();
  put_finger(0.004);
  run(1);
  ASSERT_GT(device.force.norm(), 0.1);
  breaking.broken = true;
  run(0.001);
  breaking.broken = false;
  EXPECT_EQ(last.state, ServoState::kFault);
  EXPECT_EQ(last.reason, StateReason::kNotFinite);
  run(1);
  EXPECT_EQ(last.state, ServoState::kFault);
  EXPECT_EQ(device.force.norm(), 0);
  EXPECT_LE(largest_step_n, options.chain.limits.largest_slew_n_s * 0.001 + 1e-12);
}

TEST_F(ServoTest, RejectedAnswerDoesNotMakeTheModelYounger) {
  enable();
  put_finger(0.004);
  run(1);
  const auto answer_of = [&](double contrast) {
    ServoAnswer answer;
    answer.sample = tissue.answer({0.02, 0.004, 0}, 1e-9 * static_cast<double>(clock.time_ns), ++sequence);
    answer.sample.force_n *= contrast;
    answer.received_ns = clock.time_ns;
    answer.covered = true;
    answer.period_s = 0.002;
    return answer;
  };
  silent = true;
  run(0.02);
  const double age_s = last.model_age_s;
  servo->answers().put(answer_of(50));
  run(0.001);
  EXPECT_LT(last.silence_s, 0.002);  // the link is alive
  EXPECT_GT(last.model_age_s, age_s);
  servo->answers().put(answer_of(1));
  run(0.001);
  EXPECT_LT(last.model_age_s, 0.002);
}

TEST_F(ServoTest, PauseAndDisableAreObeyed) {
  enable();
  put_finger(0.004);
  run(1);
  servo->request_pause();
  run(0.1);
  EXPECT_EQ(last.state, ServoState::kPaused);
  EXPECT_EQ(device.force.norm(), 0);
  servo->request_disable();
  run(0.01);
  EXPECT_EQ(last.state, ServoState::kDisabled);
}

TEST_F(ServoTest, StoppingSlewsTheForceToZeroFirst) {
  enable();
  put_finger(0.004);
  run(1);
  EXPECT_GT(device.force.norm(), 0.5);
  std::atomic<bool> stop{true};
  servo->run(stop);
  EXPECT_EQ(device.force.norm(), 0);
  EXPECT_GT(servo->ticks(), 1010u);  // not in one step
  ServoTick tick;
  while (servo->telemetry().pop(tick)) {
    EXPECT_LE((tick.force_n - last.force_n).norm(), options.chain.limits.largest_slew_n_s * 0.001 + 1e-12);
    last = tick;
  }
}

TEST(AllocationCount, SeesOperatorNewAndEigen) {
  teletact::test::count_allocations(true);
  void* const asked_for = ::operator new(10);  // clang leaves out `new int`
  const Eigen::VectorXd vector = Eigen::VectorXd::Constant(10, 1.0);
  teletact::test::count_allocations(false);
  const std::vector<double> uncounted(10);
  ::operator delete(asked_for);
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  EXPECT_GE(teletact::test::counted_allocations(), 1u);
#else
  EXPECT_EQ(teletact::test::counted_allocations(), 2u) << vector.sum() << uncounted.size();
#endif
}

TEST_F(ServoTest, AllocatesNothingInTheLoop) {
  enable();
  put_finger(0.004);
  teletact::test::count_allocations(true);
  run(0.5);
  teletact::test::count_allocations(false);
  EXPECT_EQ(teletact::test::counted_allocations(), 0u);
}

// The whole operator side on simulated time: device, hand, Kalman, chain; answers 4 ms old at 250 Hz.
TEST(ServoWithHand, FeelsTheTissueWhileExploring) {
  SimulatedDeviceOptions device_options;
  device_options.profile = device_profile("premium-1.5");
  device_options.hand.begin_m = device_options.hand.start_m = 0.01;
  device_options.hand.end_m = 0.11;
  SimulatedDevice device(device_options);
  device.open();
  KalmanRenderer renderer;
  ManualClock clock;
  ServoOptions options;
  options.chain.limits = device.profile().limits();
  const auto servo = std::make_unique<ServoLoop>(device, renderer, clock, options);
  const test::AnalyticTissue tissue;
  std::uint64_t sequence = 0;
  ServoAnswer on_the_way;
  std::vector<double> errors;
  TickStatistics statistics;
  for (int n = 0; n < 8000; ++n) {
    clock.time_ns += 1'000'000;
    if (n % 4 == 0) {
      on_the_way.received_ns = clock.time_ns;
      if (n > 0) servo->answers().put(on_the_way);
      ServoPose pose;
      servo->poses().take(pose);
      on_the_way.sample =
          tissue.told(pose.pose.position_m, 1e-9 * static_cast<double>(pose.time_ns), ++sequence);
      on_the_way.covered = true;
      on_the_way.region.end_x_m = 0.12;
    }
    servo->tick(clock.time_ns);
    ServoTick tick;
    while (servo->telemetry().pop(tick)) {
      statistics.add(tick);
      const Vector3 truth = tissue.answer(device.exact().position_m).force_n;
      if (n > 3000 && truth.norm() > 0.05) errors.push_back((tick.force_n - truth).norm() / truth.norm());
    }
  }
  ASSERT_GT(errors.size(), 4000u);
  EXPECT_LE(percentile(errors, 0.5), 0.03);
  EXPECT_LE(percentile(errors, 0.95), 0.10);
  EXPECT_EQ(statistics.stalls().count(), 0u);
  EXPECT_GE(device.hand().passes(), 5u);
  std::printf("[ felt  ] force error median %.4f, p95 %.4f, max %.4f; %u passes\n", percentile(errors, 0.5),
              percentile(errors, 0.95), percentile(errors, 1), device.hand().passes());
}

TEST(TickStatistics, LostForceLeavesOutTheEndAskedFor) {
  TickStatistics statistics;
  ServoTick tick;
  const auto go = [&](ServoState state, int ticks) {
    tick.state = state;
    for (int n = 0; n < ticks; ++n, tick.time_ns += 1'000'000) statistics.add(tick);
  };
  go(ServoState::kDisabled, 10);
  go(ServoState::kEnabled, 20);
  EXPECT_EQ(statistics.lost_s(), 0);
  go(ServoState::kPaused, 5);
  go(ServoState::kFault, 2);
  go(ServoState::kDisabled, 30);
  EXPECT_NEAR(statistics.enabled_s(), 0.020, 1e-9);
  EXPECT_NEAR(statistics.lost_s(), 0.007, 1e-9);
  EXPECT_NEAR(statistics.lost_now_s(), 0.007, 1e-9);
}

TEST(SpellCounter, CountsStallsLongerThanAMillisecond) {
  SpellCounter stalls(kStallS);
  const auto hold = [&](double from_s, double to_s) {
    for (double t = from_s - 0.0005; t < to_s + 0.0006; t += 0.0005) {
      stalls.add(t, t > from_s - 1e-9 && t < to_s - 1e-9);
    }
  };
  hold(1, 1.001);  // exactly 1 ms: no stall
  EXPECT_EQ(stalls.count(), 0u);
  hold(2, 2.1);
  hold(3, 3.002);
  EXPECT_EQ(stalls.count(), 2u);
  EXPECT_NEAR(stalls.seconds(), 0.102, 1e-3);
}

TEST(Percentile, IsTheSmallestValueThatCoversTheShare) {
  std::vector<double> values = {5, 1, 4, 2, 3};
  EXPECT_EQ(percentile(values, 0.5), 3);
  EXPECT_EQ(percentile(values, 0.99), 5);
  EXPECT_EQ(percentile(values, 0), 1);
  std::vector<double> none;
  EXPECT_EQ(percentile(none, 0.5), 0);
}

}  // namespace
}  // namespace teletact::client
