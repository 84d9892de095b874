// Which positions count as frozen, and that a hand at rest is none, on the test's own clock.
#include "client/haptic/freshness_watch.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <string>

#include "tests/support/environment.h"

namespace teletact::client {
namespace {

constexpr double kTickS = 1e-3;

// A device that is read once a millisecond.
class Watched {
 public:
  explicit Watched(bool has_noise = true) : watch(has_noise) {}
  Freshness tick(const FreshnessSample& sample, std::int64_t after_ns = 1'000'000) {
    now_ns += after_ns;
    return watch.judge(now_ns, sample);
  }
  // Seconds from the last change on until it is not fresh; at most `max_s`.
  double frozen_after_s(const FreshnessSample& sample, Freshness& found, double max_s = 1) {
    for (double s = kTickS; s < max_s; s += kTickS)
      if ((found = tick(sample)) != Freshness::kFresh) return s;
    return max_s;
  }
  FreshnessWatch watch;
  std::int64_t now_ns = 1'000'000'000;
};

// Down by 8 mm/s, for a second, in steps of `step_m` at least.
FreshnessSample pressed(Watched& device, double step_m = 0) {
  FreshnessSample sample;
  sample.under_force = true;
  for (int n = 1; n <= 1000; ++n) {
    const double way_m = 8e-6 * n;
    sample.position_m = Vector3(0.01, step_m > 0 ? std::round(way_m / step_m) * step_m : way_m, 0);
    EXPECT_EQ(device.tick(sample), Freshness::kFresh) << n;
  }
  return sample;
}

FreshnessSample turned(FreshnessSample sample, double angle) {
  sample.orientation = Eigen::Vector4d(std::cos(angle / 2), 0, 0, std::sin(angle / 2));
  return sample;
}

// Each is pressed, and stands then for 5 s at most. clients/ros has the same table.
TEST(FreshnessWatch, JudgesAsTheTableSays) {
  std::ifstream table(teletact::test::required_environment("TELETACT_SOURCE_DIR") +
                      "/tests/haptic/freshness_cases.json");
  for (const auto& row : nlohmann::json::parse(table)) {
    SCOPED_TRACE(row.dump());
    Watched device(row.value("noise", true));
    FreshnessSample sample = pressed(device, row.value("step_m", 0.0));
    sample.under_force = row.value("force", true);
    if (row.contains("velocity_m_s")) sample.velocity_m_s = Vector3(0, 0, row["velocity_m_s"]);
    const double turns_rad_s = row.value("turns_rad_s", 0.0);
    Freshness found = Freshness::kFresh;
    int n = 0;
    while (found == Freshness::kFresh && n < 5000)
      found = device.tick(turned(sample, turns_rad_s * 1e-3 * ++n));
    const std::string against = row["against"];
    EXPECT_EQ(found == Freshness::kFresh, against.empty());
    EXPECT_NE(std::string(describe(found)).find(against), std::string::npos) << describe(found);
    EXPECT_NEAR(n, against.empty() ? 5000 : 100, 1);
  }
}

TEST(FreshnessWatch, OneStepInTheLastBitIsFresh) {
  Watched device;
  FreshnessSample sample = pressed(device);
  for (int n = 0; n < 2000; ++n) {
    if (n % 90 == 0) sample.position_m.z() = std::nextafter(sample.position_m.z(), 1.0);
    ASSERT_EQ(device.tick(sample), Freshness::kFresh) << n;
  }
}

TEST(FreshnessWatch, ADeviceThatStoodIsFrozenOnceItGivesForce) {
  Watched device;
  FreshnessSample sample = pressed(device);
  sample.under_force = false;
  for (int n = 0; n < 1000; ++n) ASSERT_EQ(device.tick(sample), Freshness::kFresh) << n;
  sample.under_force = true;
  EXPECT_EQ(device.tick(sample), Freshness::kStandsStill);
}

// It stood for long, and begins to contradict itself then.
TEST(FreshnessWatch, AVelocityThatSetsInLateTellsWithinATenth) {
  Watched device(false);
  FreshnessSample sample = pressed(device);
  sample.velocity_m_s = Vector3::Zero();
  for (int n = 0; n < 1017; ++n) ASSERT_EQ(device.tick(sample), Freshness::kFresh) << n;
  sample.velocity_m_s = Vector3(0.008, 0, 0);
  Freshness found{};
  EXPECT_LE(device.frozen_after_s(sample, found), 0.1);
  EXPECT_EQ(found, Freshness::kAgainstVelocity);
}

TEST(FreshnessWatch, StepsOfAFastHandAreNotCoarse) {
  Watched device;
  FreshnessSample sample = pressed(device);
  for (int n = 0; n < 100; ++n) {
    sample.position_m.y() += 2e-4;
    for (int k = 0; k < 3; ++k) ASSERT_EQ(device.tick(sample), Freshness::kFresh);
  }
  Freshness found{};
  EXPECT_NEAR(device.frozen_after_s(sample, found), 0.1, 0.0035);
}

TEST(FreshnessWatch, AStallOfTheReaderIsNoStand) {
  Watched device;
  const FreshnessSample sample = pressed(device);
  for (int n = 0; n < 5; ++n) EXPECT_EQ(device.tick(sample, 500'000'000), Freshness::kFresh) << n;
}

TEST(FreshnessWatch, BeginsAnewWhenItIsRestarted) {
  Watched device(false);
  const FreshnessSample sample = pressed(device);
  device.watch.restart();
  for (int n = 0; n < 500; ++n) ASSERT_EQ(device.tick(sample), Freshness::kFresh) << "it forgot the switch";
}

// --- an hour of a hand that holds on ----------------------------------------------------------------------

// Normal deviates from a table, which takes a tenth of the time.
class Noise {
 public:
  Noise() {
    std::mt19937_64 engine(7);
    std::normal_distribution<double> normal;
    for (double& value : table_) value = normal(engine);
  }
  double operator()() {
    state_ = state_ * 6364136223846793005ull + 1442695040888963407ull;
    return table_[state_ >> 52];
  }
  Vector3 vector() { return {(*this)(), (*this)(), (*this)()}; }

 private:
  std::array<double, 4096> table_;
  std::uint64_t state_ = 1;
};

struct HeldHand {
  double tremor_m = 0, noise_m = 0, step_m = 0, velocity_noise_m_s = 0;
};

// It presses, then holds for an hour: it trembles with 8 Hz, its grip too, and wanders by some
// tenths of a millimetre.
unsigned false_alarms_in_an_hour(const HeldHand& hand) {
  Watched device;
  Noise noise;
  FreshnessSample sample = pressed(device, hand.step_m);
  const Vector3 held_m = sample.position_m;
  Vector3 wandered_m = Vector3::Zero();
  constexpr double kTurn = 2 * std::numbers::pi;
  std::array<double, 125> tremor;  // of one period of 8 Hz
  for (std::size_t n = 0; n < tremor.size(); ++n) tremor[n] = std::sin(kTurn * double(n) / 125);
  unsigned alarms = 0;
  for (int n = 0; n < 3'600'000; ++n) {
    const auto trembles = [&](int phase) { return hand.tremor_m * tremor[std::size_t((n + phase) % 125)]; };
    if (n % 100 == 0) wandered_m = 0.99 * wandered_m + 3e-5 * noise.vector();
    Vector3 at_m = held_m + wandered_m + Vector3(trembles(0), trembles(40), trembles(80)) +
                   hand.noise_m * noise.vector();
    if (hand.step_m > 0) at_m = (at_m / hand.step_m).array().round() * hand.step_m;
    sample.position_m = at_m;
    sample.velocity_m_s = 8 * kTurn * Vector3(trembles(31), trembles(71), trembles(111)) +
                          hand.velocity_noise_m_s * noise.vector();
    if (device.tick(turned(sample, 0.02 * tremor[std::size_t(n % 125)] + 0.001 * noise())) !=
        Freshness::kFresh)
      ++alarms;
  }
  return alarms;
}

TEST(FreshnessWatch, NoFalseAlarmInAnHourOfARestingHand) {
  HeldHand hand;
  hand.noise_m = 5e-7;
  hand.velocity_noise_m_s = 1e-3;
  EXPECT_EQ(false_alarms_in_an_hour(hand), 0u);
}

TEST(FreshnessWatch, NoFalseAlarmInAnHourOfATremblingHand) {
  HeldHand hand;
  hand.tremor_m = 5e-5;
  hand.velocity_noise_m_s = 1e-3;
  EXPECT_EQ(false_alarms_in_an_hour(hand), 0u);
}

TEST(FreshnessWatch, NoFalseAlarmInAnHourOfAQuantisedHand) {
  for (const double tremor_m : {5e-5, 0.0}) {
    HeldHand hand;
    hand.tremor_m = tremor_m;
    hand.noise_m = 2e-6;
    hand.step_m = 1e-4;
    EXPECT_EQ(false_alarms_in_an_hour(hand), 0u) << tremor_m;
  }
}

}  // namespace
}  // namespace teletact::client
