// The operator side and the real service with a bad link between them: what is felt, how old the data gets,
// and how soon touch is back. The link is the fault proxy's; the claims are read from the recording.
//
// TELETACT_FAULT_SECONDS=60 in the environment makes the windows of the jitter tests as long as the promise:
// ctest -C long -R faults_60s.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "client/link/touch_session.h"
#include "client/servo/tick_statistics.h"
#include "tests/integration/process.h"
#include "tests/integration/touched_scene.h"
#include "tests/support/fault_proxy.h"

namespace teletact {
namespace {

using client::ServoState;
using Kind = test::FaultEvent::Kind;
using test::now_s;
using test::TouchRecording;
using test::TouchTick;

constexpr double kPressedM = 0.002, kResumeS = 1.0;
constexpr double kAgeIsZeroS = 0.5;  // force_chain.h: nothing is felt of a model older than twice its limit
constexpr const char* kScene = "faults";

void sleep_s(double seconds) {
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
}

class Faults : public ::testing::Test {
 protected:
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
    client::TouchSessionOptions options;
    options.address = proxy.address();
    options.open.set_scene_id(kScene);
    options.open.set_period_s(period_s);
    options.open.set_credit(credit);
    options.begin_m = 0.03;
    options.end_m = 0.09;
    options.wait_s = 10;
    options.real_time = false;  // not for the threads of a test binary
    options.record_path = *folder_ / "record";
    this->period_s = period_s;
    this->credit = credit;
    std::atomic<bool> stop{false};
    std::thread session([&] { summary = client::run_touch_session(options, stop); });
    EXPECT_TRUE(test::finger_presses(address_, kScene, kPressedM, 20));
    sleep_s(0.8);
    during();
    stop = true;
    session.join();
    recording = test::read_touch_recording(options.record_path);
    expect_the_laws();
  }

  // What holds whatever the link does.
  void expect_the_laws() const {
    const client::SilenceLimits silence = client::silence_limits(period_s);
    const double slew_n_s = client::device_profile("premium-1.5").limits().largest_slew_n_s;
    ASSERT_GT(recording.ticks.size(), 1000u);
    double worst_step = 0;
    for (std::size_t k = 1; k < recording.ticks.size(); ++k) {
      const TouchTick &tick = recording.ticks[k], &before = recording.ticks[k - 1];
      const double allowed_n = slew_n_s * std::min(tick.time_s - before.time_s, 0.002);
      ASSERT_LE(tick.rise_n(before), allowed_n * (1 + 1e-6) + 1e-9) << "a rise over the slew limit";
      worst_step = std::max(worst_step, tick.rise_n(before) / allowed_n);
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

  // What makes latency grow is poses that wait for one another. Beyond the credit only heartbeats go out.
  void expect_that_nothing_queues() const {
    double last_s = 0;
    std::size_t early = 0, beyond = 0;
    for (const TouchRecording::Pose& pose : recording.poses) {
      if (pose.in_flight > credit + 1) {  // an answer may be recorded just after the pose that it allowed
        ++beyond;
        early += pose.sent_s - last_s < 0.9 * client::TouchLink::kHeartbeatS;
      }
      last_s = pose.sent_s;
    }
    EXPECT_GT(recording.poses.size(), 20u);
    // Answers that a bad link brings together may each allow a pose before they are recorded: a few. Without
    // credit it would be most of them.
    EXPECT_LE(early, recording.poses.size() / 20) << "of " << beyond << " poses beyond the credit";
  }

  // Deep in the tissue, past the ramp, told in time and trusted: then it is felt, however bad the link.
  void expect_force_where_nothing_takes_it() const {
    const client::SilenceLimits silence = client::silence_limits(period_s);
    double enabled_s = -1;
    std::size_t seen = 0;
    for (const TouchTick& tick : recording.ticks) {
      if (tick.state != ServoState::kEnabled || tick.degraded || tick.silence_s > silence.fade_s)
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
  std::vector<TouchTick> between(double begin_s, double end_s) const {
    std::vector<TouchTick> ticks;
    for (const TouchTick& tick : recording.ticks)
      if (tick.time_s >= begin_s && tick.time_s < end_s) ticks.push_back(tick);
    return ticks;
  }
  // Force just before `time_s`, the mean of 100 ms.
  double force_before_n(double time_s) const {
    const auto ticks = between(time_s - 0.1, time_s);
    double sum_n = 0;
    for (const TouchTick& tick : ticks) sum_n += tick.size_n();
    return ticks.empty() ? 0 : sum_n / static_cast<double>(ticks.size());
  }
  static double longest_silence_s(const std::vector<TouchTick>& ticks) {
    double longest_s = 0;
    for (const TouchTick& tick : ticks) longest_s = std::max(longest_s, tick.silence_s);
    return longest_s;
  }
  bool felt_again_after(double time_s) const {
    return std::any_of(recording.ticks.begin(), recording.ticks.end(), [&](const TouchTick& tick) {
      return tick.time_s > time_s && tick.state == ServoState::kEnabled && tick.size_n() > 0.2;
    });
  }

  // Fades in the middle of the silence, is zero at its end and PAUSED, back only out of contact.
  void expect_faded(double begin_s, double end_s) const {
    const client::SilenceLimits silence = client::silence_limits(period_s);
    const double before_n = force_before_n(begin_s);
    EXPECT_GT(before_n, 0.3);
    bool faded = false, zero = false;
    for (const TouchTick& tick : between(begin_s, end_s)) {
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

  static std::unique_ptr<test::TemporaryFolder> folder_;
  static std::unique_ptr<test::Process> service_;
  static std::string address_;
  test::FaultProxy proxy{address_};
  TouchRecording recording;
  client::TouchSummary summary;
  double period_s = 0;
  unsigned credit = 0;
};
std::unique_ptr<test::TemporaryFolder> Faults::folder_;
std::unique_ptr<test::Process> Faults::service_;
std::string Faults::address_;

TEST_F(Faults, AStallAt100HzFadesPast50MillisecondsAndIsZeroPast150) {
  double short_s = 0, long_s = 0, back_s = 0;
  touch(0.01, [&] {
    short_s = now_s();
    proxy.play({.kind = Kind::kStall, .seconds = 0.09});
    sleep_s(0.6);
    long_s = now_s();
    proxy.play({.kind = Kind::kStall, .seconds = 0.5});
    sleep_s(0.5);
    back_s = now_s();
    sleep_s(2.0);
  });
  // GIVEN a stall of 90 ms THEN the force fades a little and comes back, without a pause
  const auto stalled = between(short_s, short_s + 0.4);
  const double faded_n = std::min_element(stalled.begin(), stalled.end(), [](const auto& a, const auto& b) {
                           return a.size_n() < b.size_n();
                         })->size_n();
  EXPECT_LT(faded_n, 0.85 * force_before_n(short_s));
  EXPECT_GT(longest_silence_s(stalled), 0.07);
  // A busy machine can make more of it: until then, that is.
  std::size_t kept = 0;
  for (const TouchTick& tick : stalled) {
    if (tick.silence_s > 0.14) break;
    ++kept;
    ASSERT_GT(tick.size_n(), 0) << tick.silence_s;
    ASSERT_EQ(tick.state, ServoState::kEnabled) << tick.silence_s;
  }
  EXPECT_GT(kept, 50u);
  // GIVEN one of 500 ms THEN it is zero, and comes back when resumed out of contact
  expect_faded(long_s, back_s);
  EXPECT_LE(recording.answer_after_s(back_s) - back_s, kResumeS);
  EXPECT_TRUE(felt_again_after(back_s));
}

TEST_F(Faults, At10HzTheSameLimitsAreScaled) {
  double stalled_s = 0, back_s = 0;
  touch(0.1, [&] {
    sleep_s(0.5);
    stalled_s = now_s();
    proxy.play({.kind = Kind::kStall, .seconds = 1.3});
    sleep_s(1.3);
    back_s = now_s();
    sleep_s(2.5);
  });
  expect_faded(stalled_s, back_s);
  for (const TouchTick& tick : between(stalled_s - 0.5, stalled_s))
    EXPECT_EQ(tick.state, ServoState::kEnabled) << "0.1 s between answers is no silence at 10 Hz";
  EXPECT_LE(recording.answer_after_s(back_s) - back_s, kResumeS);
  EXPECT_TRUE(felt_again_after(back_s));
}

TEST_F(Faults, ResetHalfOpenAndOvertakenStreamsAreOpenedAgainWithinASecond) {
  std::vector<double> begun_s;
  const auto break_link = [&](test::FaultEvent event) {
    begun_s.push_back(now_s());
    proxy.play(event);
    sleep_s(3);
  };
  touch(0.01, [&] {
    break_link({.kind = Kind::kReset});
    break_link({.kind = Kind::kHalfOpen});
    break_link({.kind = Kind::kHold, .seconds = 1.5});  // then says what it had to say, beside the new stream
  });
  for (const double fault_s : begun_s) {
    EXPECT_GT(force_before_n(fault_s), 0.3) << "not pressed before the fault";
    // New connections pass at once: the link is back the moment it breaks.
    const double again_s = recording.answer_after_s(fault_s + 0.03) - fault_s;
    std::printf("[ resume] answers %.3f s after the fault\n", again_s);
    EXPECT_LE(again_s, kResumeS);
    EXPECT_TRUE(felt_again_after(fault_s + 0.5));
  }
  EXPECT_EQ(summary.link.streams, 4u);
}

TEST_F(Faults, ALongOutageIsOverWithinASecondOfTheLinkBeingBack) {
  double back_s = 0;
  touch(0.01, [&] {
    proxy.play({.kind = Kind::kStall, .seconds = 5});
    sleep_s(5);
    back_s = now_s();
    sleep_s(2);
  });
  const double again_s = recording.answer_after_s(back_s) - back_s;
  std::printf("[ resume] answers %.3f s after the link was back\n", again_s);
  EXPECT_LE(again_s, kResumeS);
  EXPECT_TRUE(felt_again_after(back_s));
}

double fault_seconds() {
  const char* text = std::getenv("TELETACT_FAULT_SECONDS");
  return text == nullptr ? 6 : std::max(std::atof(text), 3.0);
}

// Growth over the run of the ages, by a straight line through their means of one second each, and its
// standard error.
struct Growth {
  double over_run_s = 0, error_s = 0;
};
Growth growth_of(const std::vector<TouchRecording::Answer>& answers, double begin_s, double seconds) {
  const auto bins = static_cast<Eigen::Index>(seconds);
  Eigen::VectorXd sums = Eigen::VectorXd::Zero(bins), counts = sums;
  for (const TouchRecording::Answer& answer : answers) {
    const auto bin = static_cast<Eigen::Index>(std::floor(answer.received_s - begin_s));
    if (bin < 0 || bin >= bins) continue;
    sums[bin] += answer.age_s;
    ++counts[bin];
  }
  std::vector<double> time, age_s;
  for (Eigen::Index bin = 0; bin < bins; ++bin) {
    if (counts[bin] == 0) continue;
    time.push_back((static_cast<double>(bin) + 0.5) / static_cast<double>(bins) - 0.5);
    age_s.push_back(sums[bin] / counts[bin]);
  }
  Eigen::MatrixX2d line(time.size(), 2);
  line.col(0).setOnes();
  line.col(1) = Eigen::Map<Eigen::VectorXd>(time.data(), line.rows());
  const Eigen::Map<Eigen::VectorXd> values(age_s.data(), line.rows());
  const Eigen::Vector2d fit = line.colPivHouseholderQr().solve(values);
  const double freedom = static_cast<double>(line.rows() - 2);
  const double variance = (values - line * fit).squaredNorm() / freedom;
  return {fit[1], std::sqrt(variance * (line.transpose() * line).inverse()(1, 1))};
}

// One condition of a bad link, both ways, and for what share of the time force has to be on all the same.
// None where silence passes its limit several times a second: there force is off by design, and the claims
// are the age's and what holds on every link.
struct BadLink {
  const char* name;
  test::DirectionFaults faults;
  std::optional<double> least_force_share;
};

class FaultsOfALink : public Faults, public ::testing::WithParamInterface<BadLink> {};

TEST_P(FaultsOfALink, BoundTheAgeAndDoNotLetLatencyGrow) {
  const test::DirectionFaults& bad = GetParam().faults;
  double begin_s = 0;
  const double seconds = fault_seconds();
  touch(
      0.01,
      [&] {
        proxy.play({.faults = {bad, bad}});
        sleep_s(0.5);
        begin_s = now_s();
        sleep_s(seconds);
      },
      8);
  std::vector<double> first_s, last_s, all_s;
  for (const TouchRecording::Answer& answer : recording.answers) {
    const double share = (answer.received_s - begin_s) / seconds;
    if (share < 0) continue;
    all_s.push_back(answer.age_s);
    if (share < 0.4) first_s.push_back(answer.age_s);
    if (share > 0.6) last_s.push_back(answer.age_s);
  }
  ASSERT_GT(first_s.size(), 10u);
  ASSERT_GT(last_s.size(), 10u);
  // Two ways of jitter and retransmission, and a pose that waited for a busy machine.
  EXPECT_LE(client::percentile(all_s, 1), 2 * (bad.jitter_s + bad.retransmission_s) + 0.3);
  EXPECT_LE(client::percentile(last_s, 0.5),
            client::percentile(first_s, 0.5) + std::max(bad.jitter_s, bad.retransmission_s))
      << "latency grows";
  const Growth growth = growth_of(recording.answers, begin_s, seconds);
  // Answers that wait for one another err together: a short run cannot tell growth from chance by less than
  // the link's own delays. What would grow, a queue, is looked for in every recording.
  const double chance_s = seconds < 30 ? std::max(bad.jitter_s, bad.retransmission_s) : 0.05;
  EXPECT_LE(growth.over_run_s, std::max(chance_s, 4 * growth.error_s)) << "latency grows";
  // Both clocks are this machine's: the offset is zero, and known to be to half of the quickest round trip.
  EXPECT_LE(std::abs(summary.link.clock_offset_s), summary.link.clock_offset_error_s);
  EXPECT_LE(summary.link.clock_offset_error_s, 0.3);
  // A link without force has no steps to fear: it was on, in contact.
  const auto ticks = between(begin_s, begin_s + seconds);
  const auto with_force =
      std::count_if(ticks.begin(), ticks.end(), [](const TouchTick& tick) { return tick.size_n() > 0.05; });
  const double share = static_cast<double>(with_force) / static_cast<double>(ticks.size());
  if (GetParam().least_force_share) {
    EXPECT_GE(share, *GetParam().least_force_share);
  }
  std::printf(
      "[ age   ] median %.3f s at first, %.3f s at last, largest %.3f s, %zu answers in %.0f s; growth %+.3f "
      "+- %.3f s; force on for %.3f of the time\n",
      client::percentile(first_s, 0.5), client::percentile(last_s, 0.5), client::percentile(all_s, 1),
      all_s.size(), seconds, growth.over_run_s, growth.error_s, share);
}

INSTANTIATE_TEST_SUITE_P(
    Faults, FaultsOfALink,
    ::testing::Values(
        BadLink{"JitterAndLoss", {.jitter_s = 0.3, .loss_share = 0.1, .retransmission_s = 0.2}, {}},
        BadLink{"Jitter", {.jitter_s = 0.3, .retransmission_s = 0}, {}},
        BadLink{"Loss", {.loss_share = 0.1, .retransmission_s = 0.2}, {}},
        BadLink{"JitterOf100ms", {.jitter_s = 0.1, .retransmission_s = 0}, 0.7},
        BadLink{"LossOf60ms", {.loss_share = 0.1, .retransmission_s = 0.06}, 0.7}),
    [](const auto& test) { return std::string(test.param.name); });

TEST_F(Faults, ANarrowLinkSlowsTheStreamButDoesNotAgeIt) {
  double begin_s = 0;
  touch(0.01, [&] {
    proxy.play({.faults = {{}, {.bandwidth_bytes_s = 20e3}}});
    sleep_s(0.5);
    begin_s = now_s();
    sleep_s(3);
  });
  std::vector<double> ages_s;
  for (const TouchRecording::Answer& answer : recording.answers)
    if (answer.received_s > begin_s) ages_s.push_back(answer.age_s);
  ASSERT_GT(ages_s.size(), 20u);
  EXPECT_LE(client::percentile(ages_s, 1), 0.5);
  std::printf("[ age   ] median %.3f s, largest %.3f s, %zu answers\n", client::percentile(ages_s, 0.5),
              client::percentile(ages_s, 1), ages_s.size());
}

}  // namespace
}  // namespace teletact
