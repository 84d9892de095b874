// A touch session with the fault proxy between it and a real service, what holds whatever the link does, and
// what is read from the recording.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "client/servo/tick_statistics.h"
#include "client/session/operator_session.h"
#include "tests/integration/process.h"
#include "tests/integration/touched_scene.h"
#include "tests/support/fault_proxy.h"

namespace teletact {

inline void sleep_s(double seconds) {
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
}

class Faults : public ::testing::Test {
 protected:
  using ServoState = client::ServoState;
  static constexpr double kPressedM = 0.002, kResumeS = 1.0;
  // force_chain.h: nothing is felt of a model older than twice its limit
  static constexpr double kAgeIsZeroS = 0.5;
  static constexpr const char* kScene = "faults";

  static void SetUpTestSuite() {
    folder_ = std::make_unique<test::TemporaryFolder>();
    address_ = "unix:" + (*folder_ / "s");
    service_ = std::make_unique<test::Process>(
        std::vector<std::string>{test::service_binary(), "serve", "--listen", address_}, *folder_ / "log");
    ASSERT_TRUE(service_->says("serving on", 300)) << service_->output();
    test::create_touched_scene(address_, kScene);
  }
  static void TearDownTestSuite() {
    service_.reset();
    folder_.reset();
  }

  // Touches through the proxy until `during` is over; starts it when the finger is pressed and past the ramp.
  void touch(double period_s, const std::function<void()>& during, unsigned credit = 2) {
    client::OperatorSessionOptions options;
    options.address = proxy.address();
    options.open.set_scene_id(kScene);
    options.open.set_period_s(period_s);
    options.open.set_credit(credit);
    options.renderer = "kalman";  // by answers alone
    options.begin_m = 0.03;
    options.end_m = 0.09;
    options.wait_s = 10;
    options.real_time = false;  // not for the threads of a test binary
    options.record_path = *folder_ / "record";
    this->period_s = period_s;
    this->credit = credit;
    std::atomic<bool> stop{false};
    std::thread session([&] { summary = client::run_operator_session(options, stop); });
    EXPECT_TRUE(test::finger_presses(address_, kScene, kPressedM, 20));
    sleep_s(0.8);
    during();
    stop = true;
    session.join();
    recording = test::read_touch_recording(options.record_path);
    expect_the_laws();
  }

  // By the negotiated period, or what the link had shown until then.
  client::SilenceLimits silence_of(const test::TouchTick& tick) const {
    return client::silence_limits(std::max(period_s, tick.expected_s));
  }

  // What holds whatever the link does.
  void expect_the_laws() const {
    const double slew_n_s = client::device_profile("premium-1.5").limits().largest_slew_n_s;
    ASSERT_GT(recording.ticks.size(), 1000u);
    double worst_step = 0;
    for (std::size_t k = 1; k < recording.ticks.size(); ++k) {
      const test::TouchTick &tick = recording.ticks[k], &before = recording.ticks[k - 1];
      const double allowed_n = slew_n_s * std::min(tick.time_s - before.time_s, 0.002);
      ASSERT_LE(tick.rise_n(before), allowed_n * (1 + 1e-6) + 1e-9) << "a rise over the slew limit";
      worst_step = std::max(worst_step, tick.rise_n(before) / allowed_n);
      const client::SilenceLimits silence = silence_of(tick);
      ASSERT_LE(silence.zero_s, 0.5) << "whatever the link has shown";
      // What silence or age has taken away is gone, or is going as fast as the slew limit lets it.
      const bool over = tick.silence_s > silence.zero_s || tick.model_age_s > kAgeIsZeroS;
      if (over && tick.size_n() > 0) {
        ASSERT_GE(before.size_n() - tick.size_n(), 0.95 * allowed_n)
            << tick.size_n() << " N after " << tick.silence_s << " s of silence, model " << tick.model_age_s;
      }
      if (tick.state == ServoState::kEnabled && before.state != ServoState::kEnabled) {
        EXPECT_LT(tick.y_m, 0) << "force was given back in contact";
        EXPECT_LT(tick.silence_s, silence.fade_s) << "force was given back without a link";
      }
    }
    expect_that_nothing_queues();
    expect_force_where_nothing_takes_it();
    EXPECT_EQ(summary.telemetry_dropped, 0u);
    std::printf("[ felt  ] largest rise %.2f of the slew limit; %zu answers, %lu streams\n", worst_step,
                recording.answers.size(), summary.link.streams);
  }

  // What makes latency grow is poses that wait for one another. A recording has the link's own order and
  // clock, so this is judged as the link decided it, to the last pose.
  void expect_that_nothing_queues() const {
    constexpr double kRoundingS = 1e-9;  // of clock readings as double
    ASSERT_GE(recording.poses.size(), 2u);
    std::uint64_t max_in_flight = 0;
    for (std::size_t k = 1; k < recording.poses.size(); ++k) {
      const test::TouchRecording::Pose &pose = recording.poses[k], &before = recording.poses[k - 1];
      max_in_flight = std::max(max_in_flight, pose.in_flight);
      if (pose.call != before.call) continue;
      const double gap_s = pose.sent_s - before.sent_s + kRoundingS;
      ASSERT_GE(gap_s, period_s / 2) << "pose " << k << ", sooner than a late one makes up for";
      // Beyond the credit only heartbeats go out, each so long after the turn that the pose would have had.
      if (pose.in_flight > credit) {
        ASSERT_GE(gap_s, period_s / 2 + client::TouchLink::kHeartbeatS)
            << "pose " << k << " of " << recording.poses.size() << ", " << pose.in_flight << " in flight";
      }
    }
    // Of a larger credit the link says how much of it is used (pacing.h).
    EXPECT_GE(max_in_flight, std::min(credit, client::Pacing::kFewest))
        << "the fewest were never in flight: nothing is shown of them";
    // A stream that is open is never quiet for longer than a period and a heartbeat; half of the time is left
    // for outages and a busy machine.
    const double span_s = recording.poses.back().sent_s - recording.poses.front().sent_s;
    const double least = 0.5 * span_s / (period_s + client::TouchLink::kHeartbeatS);
    EXPECT_GE(static_cast<double>(recording.poses.size()), least) << "in " << span_s << " s";
    std::printf("[ poses ] %zu in %.1f s, at least %.0f; most in flight %lu of %u\n", recording.poses.size(),
                span_s, least, max_in_flight, credit);
  }

  // Deep in the tissue, past the ramp, told in time and trusted: then it is felt, however bad the link.
  void expect_force_where_nothing_takes_it() const {
    double enabled_s = -1;
    std::size_t seen = 0;
    for (const test::TouchTick& tick : recording.ticks) {
      if (tick.state != ServoState::kEnabled || tick.degraded || tick.silence_s > silence_of(tick).fade_s)
        enabled_s = -1;
      else if (enabled_s < 0)
        enabled_s = tick.time_s;
      if (enabled_s < 0 || tick.time_s - enabled_s < 1 || tick.y_m < kPressedM) continue;
      ++seen;
      ASSERT_GT(tick.size_n(), 0.05) << "at " << tick.y_m << " m, model " << tick.model_age_s << " s old";
    }
    std::printf("[ felt  ] %zu of %zu ticks where nothing takes the force\n", seen, recording.ticks.size());
  }

  // The ticks within [begin, end) of the clock.
  std::vector<test::TouchTick> between(double begin_s, double end_s) const {
    std::vector<test::TouchTick> ticks;
    for (const test::TouchTick& tick : recording.ticks)
      if (tick.time_s >= begin_s && tick.time_s < end_s) ticks.push_back(tick);
    return ticks;
  }
  // Force just before `time_s`, the mean of 100 ms.
  double force_before_n(double time_s) const {
    const auto ticks = between(time_s - 0.1, time_s);
    double sum_n = 0;
    for (const test::TouchTick& tick : ticks) sum_n += tick.size_n();
    return ticks.empty() ? 0 : sum_n / static_cast<double>(ticks.size());
  }
  static double longest_silence_s(const std::vector<test::TouchTick>& ticks) {
    double longest_s = 0;
    for (const test::TouchTick& tick : ticks) longest_s = std::max(longest_s, tick.silence_s);
    return longest_s;
  }
  bool felt_again_after(double time_s) const {
    return std::any_of(recording.ticks.begin(), recording.ticks.end(), [&](const test::TouchTick& tick) {
      return tick.time_s > time_s && tick.state == ServoState::kEnabled && tick.size_n() > 0.2;
    });
  }

  // Fades in the middle of the silence, is zero at its end and PAUSED, back only out of contact.
  void expect_faded(double begin_s, double end_s) const {
    const double before_n = force_before_n(begin_s);
    EXPECT_GT(before_n, 0.3);
    bool faded = false, zero = false;
    for (const test::TouchTick& tick : between(begin_s, end_s)) {
      const client::SilenceLimits silence = silence_of(tick);
      // The hand sinks in as the force goes, so what is rendered grows while its gain falls.
      if (tick.silence_s > 0.9 * silence.zero_s && tick.silence_s < silence.zero_s) {
        faded = true;
        EXPECT_LT(tick.size_n(), 0.6 * before_n);
      }
      if (tick.silence_s > silence.zero_s + 0.02) {
        zero = true;
        EXPECT_EQ(tick.size_n(), 0) << tick.silence_s;
        EXPECT_EQ(tick.state, ServoState::kPaused);
      }
    }
    EXPECT_TRUE(faded && zero);
  }

  static inline std::unique_ptr<test::TemporaryFolder> folder_;
  static inline std::unique_ptr<test::Process> service_;
  static inline std::string address_;
  test::FaultProxy proxy{address_};
  test::TouchRecording recording;
  client::TouchSummary summary;
  double period_s = 0;
  unsigned credit = 0;
};

}  // namespace teletact
