// The operator side and the real service, and a bad link between them: how old the data gets, that nothing
// queues, and that force is on.
//
// Ten seconds hold some sixty answers of the worst link, whose jitter brings poses in bunches.
// TELETACT_FAULT_SECONDS=60 in the environment makes the windows of the jitter tests as long as the promise:
// ctest -C long -R faults_60s.
#include <Eigen/Dense>
#include <cstdlib>
#include <optional>

#include "tests/integration/faulty_link.h"

namespace teletact {
namespace {

double fault_seconds() {
  const char* text = std::getenv("TELETACT_FAULT_SECONDS");
  return text == nullptr ? 10 : std::max(std::atof(text), 3.0);
}

// Growth over the run of the ages, by a straight line through their means of one second each, and its
// standard error.
struct Growth {
  double over_run_s = 0, error_s = 0;
};
Growth growth_of(const std::vector<test::TouchRecording::Answer>& answers, double begin_s, double seconds) {
  const auto bins = static_cast<Eigen::Index>(seconds);
  Eigen::VectorXd sums = Eigen::VectorXd::Zero(bins), counts = sums;
  for (const test::TouchRecording::Answer& answer : answers) {
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
  std::optional<double> min_force_share;
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
        begin_s = test::now_s();
        sleep_s(seconds);
      },
      8);
  std::vector<double> first_s, last_s, all_s;
  for (const test::TouchRecording::Answer& answer : recording.answers) {
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
  const auto with_force = std::count_if(ticks.begin(), ticks.end(),
                                        [](const test::TouchTick& tick) { return tick.size_n() > 0.05; });
  const double share = static_cast<double>(with_force) / static_cast<double>(ticks.size());
  if (GetParam().min_force_share) {
    EXPECT_GE(share, *GetParam().min_force_share);
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

// A long link is no bad one: neither its round trip nor what is under way in it is silence.
TEST_F(Faults, AConstantRoundTripOf100MsTakesNeitherAnswersNorForce) {
  constexpr double kPeriodS = 0.005, kRoundTripS = 0.1, kSecondsS = 3;
  proxy.play({.faults = {{.delay_s = kRoundTripS / 2}, {.delay_s = kRoundTripS / 2}}});
  double begin_s = 0;
  touch(
      kPeriodS,
      [&] {
        begin_s = test::now_s();
        sleep_s(kSecondsS);
      },
      client::Pacing::kMax);
  std::vector<double> ages_s;
  for (const test::TouchRecording::Answer& answer : recording.answers)
    if (answer.received_s > begin_s) ages_s.push_back(answer.age_s);
  EXPECT_GE(static_cast<double>(ages_s.size()), 0.5 * kSecondsS / kPeriodS);
  EXPECT_GE(client::percentile(ages_s, 0), kRoundTripS);
  std::size_t faded = 0;
  const auto ticks = between(begin_s, begin_s + kSecondsS);
  for (const test::TouchTick& tick : ticks) {
    ASSERT_EQ(tick.state, ServoState::kEnabled) << "silent for " << tick.silence_s;
    ASSERT_FALSE(tick.degraded) << "model " << tick.model_age_s << " s old";
    faded += tick.faded;
  }
  // The link itself takes none; a busy machine may keep an answer for 50 ms now and then.
  EXPECT_LE(static_cast<double>(faded), 0.02 * static_cast<double>(ticks.size()));
  std::printf("[ far   ] %zu answers in %.0f s, age median %.3f s, 95 %% %.3f s; %zu of %zu ticks faded\n",
              ages_s.size(), kSecondsS, client::percentile(ages_s, 0.5), client::percentile(ages_s, 0.95),
              faded, ticks.size());
}

TEST_F(Faults, ANarrowLinkSlowsTheStreamButDoesNotAgeIt) {
  double begin_s = 0;
  touch(0.01, [&] {
    proxy.play({.faults = {{}, {.bandwidth_bytes_s = 20e3}}});
    sleep_s(0.5);
    begin_s = test::now_s();
    sleep_s(3);
  });
  std::vector<double> ages_s;
  for (const test::TouchRecording::Answer& answer : recording.answers)
    if (answer.received_s > begin_s) ages_s.push_back(answer.age_s);
  ASSERT_GT(ages_s.size(), 20u);
  EXPECT_LE(client::percentile(ages_s, 1), 0.5);
  std::printf("[ age   ] median %.3f s, largest %.3f s, %zu answers\n", client::percentile(ages_s, 0.5),
              client::percentile(ages_s, 1), ages_s.size());
}

}  // namespace
}  // namespace teletact
