#include "client/render/energy_ledger.h"

#include <gtest/gtest.h>

#include <cmath>

namespace teletact::client {
namespace {

// A mass on a spring whose force is 12 ms old: an active environment (T5.2). Returns the largest amplitude of
// the last of eight seconds.
double amplitude(bool controlled, double* generated_j = nullptr) {
  constexpr double kStiffness = 300, kMass = 0.1, kDamping = 0.5, kPeriod = 0.001;
  constexpr int kDelay = 12, kSubsteps = 20;
  EnergyLedger ledger({.largest_damping_n_s_m = 20});
  double history[kDelay] = {};
  double x = 0.004, v = 0, f = 0, largest = 0, worst = 0;
  for (int n = 0; n < 8000; ++n) {
    ledger.observe({0, x, 0}, {0, f, 0}, 0, true, 0.001);
    worst = std::min(worst, ledger.energy_j());
    const double delayed = history[n % kDelay];
    history[n % kDelay] = -kStiffness * x;
    f = delayed;
    if (controlled) f += ledger.damping_force({0, v, 0}, kPeriod).y();
    for (int s = 0; s < kSubsteps; ++s) {
      v += kPeriod / kSubsteps / kMass * (f - kDamping * v);
      x += kPeriod / kSubsteps * v;
    }
    if (n > 7000) largest = std::max(largest, std::abs(x));
    if (!(std::abs(x) < 1)) return INFINITY;
  }
  if (generated_j != nullptr) *generated_j = -worst;
  return largest;
}

TEST(EnergyLedger, ControllerTakesBackWhatADelayedSpringGenerates) {
  EXPECT_GT(amplitude(false), 0.5);  // without it the same spring runs away
  double generated_j = NAN;
  EXPECT_LE(amplitude(true, &generated_j), 0.004);
  EXPECT_LE(generated_j, 0.5 * 300 * 0.004 * 0.004);
}

// Deeper than any reserve is large, slowly in and fast out.
TEST(EnergyLedger, AnIdealSpringIsLeftAloneHoweverMuchItHolds) {
  for (const double stiffness_n_m : {200.0, 800.0}) {
    EnergyLedger ledger;
    const auto stored_j = [&](double y_m) { return 0.5 * stiffness_n_m * y_m * y_m; };
    double y_m = 0, max_j = 0;
    const auto go = [&](double to_m, double speed_m_s) {
      const int steps = static_cast<int>(std::lround(std::abs(to_m - y_m) / speed_m_s / 0.001));
      const double step_m = (to_m - y_m) / steps;
      for (int n = 0; n < steps; ++n, y_m += step_m) {
        // Force at the middle of the step: exact for a spring.
        const double middle_n = stiffness_n_m * (y_m + step_m / 2);
        ledger.observe({0, y_m + step_m, 0}, {0, -middle_n, 0}, stored_j(y_m + step_m), true, 0.001);
        EXPECT_GE(ledger.energy_j(), -1e-12) << stiffness_n_m << ' ' << y_m;
        max_j = std::max(max_j, ledger.stored_j());
      }
    };
    ledger.observe({0, 0, 0}, {0, 0, 0}, 0, true, 0.001);
    go(0.014, 0.02);
    go(0, 0.5);
    EXPECT_NEAR(ledger.energy_j(), 0, 1e-12);
    EXPECT_NEAR(max_j, stored_j(0.014), 1e-9);
    EXPECT_GT(max_j, stiffness_n_m > 500 ? 0.05 : 0.01);  // the reserve is 0.02
  }
}

// However much was dissipated before: beyond the reserve and a quarter of what is held it is seen.
TEST(EnergyLedger, AForceThatIsLateIsSeenUnderADeepPress) {
  constexpr double kStiffness = 800, kDepth = 0.01, kSwing = 0.002, kReserve = 0.02;
  constexpr int kLate = 20, kTicks = 20000;
  for (const double dissipated_j : {0.0, 1.0}) {
    EnergyLedger ledger({.largest_balance_j = kReserve});
    const auto held_j = [](double y_m) { return 0.5 * kStiffness * y_m * y_m; };
    ledger.observe({0, 0, 0}, {0, 0, 0}, 0, true, 0.001);
    for (double y_m = 0; y_m < kDepth - 1e-9; y_m += 1e-4)
      ledger.observe({0, y_m + 1e-4, 0}, {0, -kStiffness * (y_m + 5e-5), 0}, held_j(y_m + 1e-4), true, 0.001);
    EXPECT_NEAR(ledger.energy_j(), held_j(kDepth) / 4, 1e-9);
    ledger.observe({dissipated_j, kDepth, 0}, {-1, 0, 0}, held_j(kDepth), true,
                   0.001);  // 1 N against the way
    const auto depth_m = [](int n) { return kDepth + kSwing * std::sin(0.03 * n); };
    double generated_j = 0;
    int n = 1;
    for (; ledger.energy_j() >= 0 && n < kTicks; ++n) {
      const double late_n = -kStiffness * depth_m(std::max(n - kLate, 0));
      generated_j += late_n * (depth_m(n) - depth_m(n - 1)) + held_j(depth_m(n)) - held_j(depth_m(n - 1));
      ledger.observe({dissipated_j, depth_m(n), 0}, {0, late_n, 0}, held_j(depth_m(n)), true, 0.001);
    }
    EXPECT_LT(n, kTicks);
    EXPECT_LT(generated_j, std::min(dissipated_j, kReserve) + held_j(kDepth + kSwing) / 4 + 1e-3);
  }
}

// A harder model under a finger that rests is paid from what was dissipated, a softer one gives back.
TEST(EnergyLedger, AChangedModelChangesWhatWasDissipated) {
  EnergyLedger ledger;
  ledger.observe({0, 0.004, 0}, {0, 0, 0}, 0, true, 0.001);
  ledger.observe({0.01, 0.004, 0}, {-1, 0, 0}, 0, true, 0.001);  // 10 mJ
  ledger.observe({0.01, 0.004, 0}, {0, -1, 0}, 0.004, true, 0.001);
  EXPECT_NEAR(ledger.energy_j(), 0.006 + 0.001, 1e-12);
  ledger.observe({0.01, 0.004, 0}, {0, -1, 0}, 0.016, true, 0.001);
  EXPECT_NEAR(ledger.energy_j(), -0.006 + 0.004, 1e-12);
  ledger.observe({0.01, 0.004, 0}, {0, -1, 0}, 0.004, true, 0.001);
  EXPECT_NEAR(ledger.energy_j(), 0.006 + 0.001, 1e-12);
}

TEST(EnergyLedger, WhatIsOwedInTheAirIsPaidByWhatIsDissipatedThere) {
  for (const double friction_n : {0.0, 0.2}) {
    EnergyLedger ledger({.friction_n = friction_n});
    ledger.observe({0, 0.002, 0}, {0, 0, 0}, 0, true, 0.001);
    ledger.observe({0, 0, 0}, {0, -5, 0}, 0, false, 0.1);  // lifted under 5 N
    EXPECT_LT(ledger.energy_j(), -0.009);
    double x_m = 0;
    for (int n = 0; n < 1000; ++n) ledger.observe({x_m += 1e-4, -0.002, 0}, {0, 0, 0}, 0, false, 0.001);
    EXPECT_NEAR(ledger.energy_j(), 0, 1e-12) << friction_n;  // .1 m: 20 mJ by friction, 20 mJ by the hand
  }
}

TEST(EnergyLedger, WhatRisesIsPaidByWhatFellAndWhatItLacksIsSaid) {
  EnergyLedger ledger;
  EXPECT_EQ(ledger.go(EnergyClaim::kLaw, 0.004, 0.5), 0);
  EXPECT_EQ(ledger.go(EnergyClaim::kSilence, 0.001, 1), 0);  // less
  EnergyLedger::Refused refused = ledger.take_refused();
  EXPECT_EQ(refused.who, EnergyClaim::kLaw);
  EXPECT_EQ(refused.lacks_j, 0.004);
  EXPECT_EQ(ledger.go(EnergyClaim::kLaw, -0.006, 0.5), 0.5);
  EXPECT_NEAR(ledger.balance_j(), 0.003, 1e-15);
  EXPECT_EQ(ledger.go(EnergyClaim::kSilence, 0.004, 0.5), 0.5);
  EXPECT_EQ(ledger.take_refused().who, EnergyClaim::kNone);
  EXPECT_NEAR(ledger.go(EnergyClaim::kRamp, 0.004, 0.5), 0.25, 1e-12);
  EXPECT_EQ(ledger.balance_j(), 0);
  refused = ledger.take_refused();
  EXPECT_EQ(refused.who, EnergyClaim::kRamp);
  EXPECT_NEAR(refused.lacks_j, 0.003, 1e-15);
  for (const double no_number : {NAN, INFINITY}) EXPECT_EQ(ledger.go(EnergyClaim::kLaw, no_number, 0.5), 0);
  ledger.earn(NAN);
  EXPECT_EQ(ledger.balance_j(), 0);
}

TEST(EnergyLedger, NoMoreIsSavedUpThanItsCapAndNothingOverALift) {
  EnergyLedger ledger;
  ledger.observe({0, 0.001, 0}, {0, 0, 0}, 0, true, 0.001);
  ledger.go(EnergyClaim::kLaw, -1, 1);
  ledger.earn(1);
  EXPECT_EQ(ledger.balance_j(), EnergyLedgerOptions{}.largest_balance_j);
  ledger.observe({0, -0.001, 0}, {0, 0, 0}, 0, false, 0.001);
  EXPECT_EQ(ledger.balance_j(), 0);
}

TEST(EnergyLedger, DampingIsClampedToTheDevice) {
  EnergyLedger ledger({.largest_damping_n_s_m = 5});
  ledger.observe({0, 0, 0}, {0, 0, 0}, 0, true, 0.001);
  ledger.observe({0, 0.01, 0}, {0, 10, 0}, 0, true,
                 0.001);  // the display pushed along the motion: 0.1 J generated
  EXPECT_NEAR(ledger.energy_j(), -0.1, 1e-12);
  const Vector3 force = ledger.damping_force({0, 0.1, 0}, 0.001);
  EXPECT_NEAR(force.y(), -0.5, 1e-12);
}

TEST(EnergyLedger, DissipationIsForgottenOffContact) {
  EnergyLedger ledger;
  ledger.observe({0, 0, 0}, {0, 0, 0}, 0, true, 0.001);
  ledger.observe({0, 0.001, 0}, {0, -5, 0}, 0, true, 0.001);
  EXPECT_GT(ledger.energy_j(), 0);
  ledger.observe({0, -0.001, 0}, {0, 0, 0}, 0, false, 0.001);
  EXPECT_EQ(ledger.energy_j(), 0);
}

TEST(EnergyLedger, WhatTheMechanismDissipatesIsInTheBudget) {
  EnergyLedger ledger({.friction_n = 0.1, .mechanism_n_s_m = 2});
  ledger.observe({0, 0, 0}, {0, 0, 0}, 0, true, 0.001);
  // 0.2 mm in 1 ms under nothing: f_c |dp| + b |dp|^2 / T
  ledger.observe({0.0002, 0, 0}, {0, 0, 0}, 0, true, 0.001);
  EXPECT_NEAR(ledger.energy_j(), 0.1 * 0.0002 + 2 * 4e-8 / 0.001, 1e-15);
}

// What is told of as dissipated is at most what was: it pays for harder models (T5.4b).
TEST(EnergyLedger, DissipationIsNeverToldTooHigh) {
  const auto told_j = [](double friction_n, double damping_n_s_m, auto&& position_m, auto&& dt_s) {
    EnergyLedger ledger({.friction_n = friction_n, .mechanism_n_s_m = damping_n_s_m});
    double time_s = 0;
    for (int n = 0; time_s < 0.5; time_s += dt_s(n), ++n) {
      ledger.observe({position_m(time_s), 0.001, 0}, {0, 0, 0}, 0, true, n == 0 ? 0.001 : dt_s(n - 1));
    }
    return ledger.dissipated_j();
  };
  const auto regular = [](int) { return 0.001; };
  const auto late = [](int n) { return n % 100 == 50 ? 0.05 : 0.001; };
  const auto moves = [](double s) { return 0.1 * s; };
  // 0.1 m/s for half a second: friction .04 N: 2 mJ; damping .5: 2.5 mJ; the hand's 2: 10 mJ
  const auto expect = [](double told, double true_j) {
    EXPECT_LE(told, 1.0001 * true_j);
    EXPECT_GE(told, 0.75 * true_j);
  };
  expect(told_j(0.04, 0, moves, regular), 2e-3);
  expect(told_j(0, 0.5, moves, regular), 2.5e-3);
  expect(told_j(0, 0, moves, regular), 1e-2);
  // ticks that come late
  expect(told_j(0, 0, moves, late), 1e-2);
  // samples that come ten times
  const auto held = [](double s) { return 0.1 * std::floor(100 * s) / 100; };
  EXPECT_LE(told_j(0, 0, held, regular), 1.02e-2);
  // an encoder that flickers by a step of 55 um at rest
  const auto flickers = [](double s) { return 55e-6 * (static_cast<int>(std::lround(1000 * s)) % 2); };
  EXPECT_LE(told_j(0.26, 0, flickers, regular), 1e-3);
  EXPECT_LE(told_j(0, 0, flickers, regular), 5e-5);
}

}  // namespace
}  // namespace teletact::client
