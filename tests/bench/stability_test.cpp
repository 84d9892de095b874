// The stability suite's own parts: its plant against closed forms, its borders against (T5.2).
#include <gtest/gtest.h>

#include <cmath>

#include "bench/stability/felt.h"
#include "bench/stability/lift.h"
#include "bench/stability/passivity_border.h"
#include "bench/stability/plant.h"
#include "bench/stability/rest.h"
#include "bench/stability/trial.h"

namespace teletact::bench {
namespace {

TEST(Plant, ReleasedMassSwingsByTheClosedForm) {
  PlantOptions options{
      .mass_kg = 0.2, .damping_n_s_m = 0.3, .hand_stiffness_n_m = 500, .hand_damping_n_s_m = 2};
  Plant plant(options, {0.01, -0.004, 0});
  for (int n = 0; n < 300; ++n) plant.step({0, 0, 0}, {});
  const double decay = 2.3 / 0.4, omega = std::sqrt(500 / 0.2 - decay * decay), t = 0.3;
  const double shape = std::exp(-decay * t) * (std::cos(omega * t) + decay / omega * std::sin(omega * t));
  EXPECT_NEAR(plant.position_m().x(), 0.01 * shape, 1e-9);
  EXPECT_NEAR(plant.position_m().y(), -0.004 * shape, 1e-9);
}

TEST(Plant, OverdampedMassLagsByTheDisplaysDamping) {
  PlantOptions options{
      .mass_kg = 0.05, .damping_n_s_m = 20, .hand_stiffness_n_m = 400, .hand_damping_n_s_m = 5};
  Plant plant(options, {0, 0, 0});
  for (int n = 0; n < 2000; ++n) plant.step({0, 0, 0}, {{0.12 * 0.001 * n, 0, 0}, {0.12, 0, 0}});
  EXPECT_NEAR(0.12 * 2 - plant.position_m().x(), 20 * 0.12 / 400, 1e-9);
}

TEST(Plant, PortHoldsTheEnergyPutInByAConstantForce) {
  // Pressed to rest against 1 N: the hand has done F dx on the display, and b v^2 was dissipated on the way.
  PlantOptions options{
      .mass_kg = 0.1, .damping_n_s_m = 0.5, .hand_stiffness_n_m = 500, .hand_damping_n_s_m = 10};
  Plant plant(options, {0, 0, 0});
  for (int n = 0; n < 3000; ++n) plant.step({0, -1, 0}, {{0.01, 0.01, 0}, {0, 0, 0}});
  EXPECT_NEAR(plant.position_m().y(), 0.01 - 1.0 / 500, 1e-9);
  // Hand's spring: 1/2 k (r^2 - (r - x)^2) was released; its damper took part, mass none, the rest is the
  // port's.
  const double released_j = 0.5 * 500 * (2 * 1e-4 - std::pow(1.0 / 500, 2));
  EXPECT_LT(plant.port_energy_j(), released_j);
  EXPECT_GT(plant.port_energy_j(), 0.008 - 1e-9);
}

TEST(Plant, FrictionHoldsAMassThatIsPulledByLess) {
  PlantOptions options{.friction_n = 0.2};
  Plant plant(options, {0, 0, 0});
  for (int n = 0; n < 1000; ++n) plant.step({0.19, 0, 0}, {});
  EXPECT_EQ(plant.position_m().norm(), 0);
  for (int n = 0; n < 3000; ++n) plant.step({0.7, 0, 0}, {});
  EXPECT_GT(plant.position_m().x(), (0.7 - 0.2) / 500 - 1e-6);
  EXPECT_LT(plant.velocity_m_s().norm(), 1e-9);
}

TEST(PassivityBorder, WorstMotionIsWithinTwoPercentOfColgate) {
  for (const double delay : {0.0, 0.1, 0.5, 0.9, 1.0, 2.3, 5.5, 10.7}) {
    const ImposedMotion motion = worst_motion(delay, static_cast<std::size_t>(60 * (1 + delay)));
    for (const double stiffness : {10.0, 1e4})
      for (const double period : {0.001, 0.5}) {
        const double bound = colgate_border_n_s_m(stiffness, period, delay * period);
        EXPECT_NEAR(border_n_s_m(motion, stiffness, period, delay * period) / bound, 1, 0.02) << delay;
      }
  }
}

// Of `samples` sampling periods per cycle over 400 of them, whole cycles, as good as smooth.
ImposedMotion slow_sinusoid(double samples) {
  constexpr int kPieces = 64, kPeriods = 400;  // an instant at every half, quarter and so on of a period
  ImposedMotion motion;
  for (int n = 0; n <= kPieces * kPeriods; ++n) {
    motion.time_periods.push_back(static_cast<double>(n) / kPieces);
    motion.position.push_back(std::sin(2 * M_PI * motion.time_periods.back() / samples));
  }
  return motion;
}

TEST(PassivityBorder, NoMotionCostsMoreThanTheWorst) {
  for (const double delay : {0.0, 0.5, 2.25}) {
    const double bound = colgate_border_n_s_m(300, 0.02, delay * 0.02);
    for (const double samples : {4.0, 8.0, 20.0, 100.0})
      EXPECT_LE(border_n_s_m(slow_sinusoid(samples), 300, 0.02, delay * 0.02), bound * (1 + 1e-9));
  }
}

TEST(PassivityBorder, ASlowSinusoidHidesAFractionalDelay) {
  EXPECT_LT(border_n_s_m(slow_sinusoid(100), 300, 0.02, 0.005),
            0.95 * colgate_border_n_s_m(300, 0.02, 0.005));
}

// A swing of that start, growing or decaying (1/s), watched from the stop on.
RestWatch watched(const RestOptions& options, double start_m, double growth_1_s, double hertz = 3) {
  RestWatch watch(options);
  for (int tick = 0; 0.001 * tick < watch.length_s(); ++tick) {
    const double t = 0.001 * tick;
    watch.add({0, start_m * std::exp(growth_1_s * t) * std::cos(2 * M_PI * hertz * t), 0}, t);
  }
  return watch;
}

TEST(RestWatch, TellsDecayFromLimitCycleAndFromInstability) {
  const RestOptions slow{.update_s = 0.5, .delay_s = 0.1};
  EXPECT_GE(watched(slow, 0, 0).length_s(), 40 * 0.6);
  EXPECT_EQ(watched(slow, 0.002, -0.05).verdict(), Verdict::kStable);
  EXPECT_GT(watched(slow, 0.002, -0.05).swing_m(), 0.0005);  // and is felt still
  EXPECT_EQ(watched(slow, 0.001, 0).verdict(), Verdict::kLimitCycle);
  EXPECT_EQ(watched(slow, 0.003, 0).verdict(), Verdict::kUnstable);
  EXPECT_EQ(watched(slow, 0.0001, 0.2).verdict(), Verdict::kUnstable);
  EXPECT_EQ(watched({}, 0.00001, 0).verdict(), Verdict::kStable);  // too small to feel
  EXPECT_EQ(watched({}, 0.001, -30).settled(), true);
}

TEST(RestWatch, NoNumberIsUnstable) {
  EXPECT_EQ(watched({}, std::nan(""), 0).verdict(), Verdict::kUnstable);
}

// JSON knows no infinity, and what is read back of it would be of another version.
TEST(Trial, SwingOfAThrownHandIsANumber) {
  TrialOptions options;
  options.renderer = "hold";
  options.sweep_m = 0;
  options.update_s = 0.1;
  options.stiffness_n_m = 20000;
  const TrialResult result = run_trial(options);
  EXPECT_EQ(result.verdict, Verdict::kUnstable);
  EXPECT_GE(result.swing_m, 0.05);
  for (const double value : {result.swing_m, result.generated_j, result.stored_j, result.drawdown,
                             result.force_error, result.exact_law_error, result.exact_tangent_error})
    EXPECT_TRUE(std::isfinite(value));
}

TEST(Trial, SlowConvergenceUnderFewAnswersIsStable) {
  TrialOptions options;
  options.device = client::device_profile("premium-1.5");
  options.renderer = "hold";
  options.sweep_m = 0.03;
  options.update_s = 0.5;
  options.stiffness_n_m = 300;
  EXPECT_EQ(run_trial(options).verdict, Verdict::kStable);
  options.stiffness_n_m = 1000;
  EXPECT_NE(run_trial(options).verdict, Verdict::kStable);
}

TEST(Trial, EnergyOfALateModelIsSeenDespiteDissipation) {
  TrialOptions options;
  options.safe = true;
  options.scene = Scene::kInclusions;
  options.stiffness_n_m = 800;
  options.device = client::device_profile("premium-1.5");
  EXPECT_LT(run_trial(options).drawdown, 0.1);
  options.model_delay_s = 0.2;
  const TrialResult late = run_trial(options);
  EXPECT_GT(late.drawdown, 0.1);
  EXPECT_LT(late.generated_j, 0.01 * late.stored_j);
}

TEST(Trial, AHeldFiftyHertzForceShakesWhereTheKalmanFilterIsStill) {
  TrialOptions options;
  options.stiffness_n_m = 800;
  options.renderer = "hold";
  EXPECT_NE(run_trial(options).verdict, Verdict::kStable);
  options.renderer = "kalman";
  const TrialResult kalman = run_trial(options);
  EXPECT_EQ(kalman.verdict, Verdict::kStable);
  EXPECT_LT(kalman.force_error, 0.02);
}

TEST(Trial, ForceOfUntoldHardTissueIsWithheld) {
  TrialOptions options;
  options.stiffness_n_m = 3000;
  options.model_delay_s = 0.1;
  options.safe = true;
  const TrialResult told = run_trial(options);
  EXPECT_EQ(told.degraded_share, 0);
  EXPECT_LT(told.generated_j, 1e-5);
  EXPECT_LT(told.force_error, 0.01);
  options.foreseen = false;
  const TrialResult unknown = run_trial(options);
  EXPECT_GT(unknown.degraded_share, 0);
  EXPECT_EQ(unknown.verdict, Verdict::kStable);
  EXPECT_LT(unknown.generated_j, 1e-5);
}

// Pressed to the largest force of each device, and lifted: nothing in the air, and no more comes back than
// was put in but for what a force held between ticks gives.
TEST(Lift, FromTheLargestForceLeavesNothingBehind) {
  for (const client::DeviceProfile& device : client::device_profiles())
    for (const std::string renderer : {"kalman", "kalman-force", "interpolate", "hold"})
      for (const LiftMotion motion : {LiftMotion::kLift, LiftMotion::kTap})
        for (const HandProfile* mover : {static_cast<const HandProfile*>(nullptr), &hands().front()}) {
          LiftOptions options;
          options.renderer = renderer;
          options.device = device;
          options.stiffness_n_m = device.largest_stiffness_n_m;
          options.damping_known = false;
          options.motion = motion;
          options.hand = mover;
          const LiftResult result = run_lift(options);
          const std::string what = device.name + ' ' + renderer +
                                   (motion == LiftMotion::kTap ? " tap" : " lift") + (mover ? " hand" : "");
          EXPECT_EQ(result.in_air_n, 0) << what;
          EXPECT_LE(result.over_allowed, 1) << what;
          if (renderer.rfind("kalman", 0) == 0) {
            EXPECT_EQ(result.degraded_share, 0) << what;
          }
          EXPECT_EQ(result.enabled_share, 1) << what;
          if (mover == nullptr) {
            EXPECT_NEAR(result.largest_n, device.largest_force_n, 1e-9) << what;
          }
        }
}

// The contact law over a far link: 20 answers a second, 300 ms late or none for 200 ms, past the display's
// stiffness and within it.
TEST(Trial, LawGivesTheForceOfThisPlaceAndNoEnergy) {
  for (const double share : {kLawWithinCap, 1.5})
    for (const double delay_s : {0.0, 0.3}) {
      TrialOptions options;
      options.renderer = "law";
      options.device = client::device_profile("omni");
      options.scene = Scene::kInclusions;
      options.stiffness_n_m = share * options.device.largest_stiffness_n_m;
      options.update_s = 0.05;
      options.model_delay_s = delay_s;
      options.stall_s = delay_s > 0 ? 0 : 0.2;
      options.indentation_m = 0.002;
      options.safe = true;
      const TrialResult result = run_trial(options);
      EXPECT_EQ(result.verdict, Verdict::kStable);
      EXPECT_GE(result.within_half, 0.99);
      EXPECT_LT(result.fast_share, 0.1);
      EXPECT_LT(result.given, 0.001);
      EXPECT_EQ(result.degraded_share, 0);
      options.law_end_m = 0.05;  // and where it ends, answers alone are felt
      const TrialResult half = run_trial(options);
      EXPECT_LT(half.within_one, 0.9);
      EXPECT_EQ(half.verdict, Verdict::kStable);
      options.renderer = "hold";
      EXPECT_GT(run_trial(options).given, 0.01);
    }
}

TEST(Lift, ChangingLawsReturnNoMoreThanWasPaidFor) {
  for (const LawTold law : {LawTold::kOne, LawTold::kChanging, LawTold::kComingAndGoing})
    for (const double stall_s : {0.0, 0.4})
      for (const LiftMotion motion : {LiftMotion::kLift, LiftMotion::kTap, LiftMotion::kSlide})
        for (const Scene scene : {Scene::kHomogeneous, Scene::kInclusions}) {
          LiftOptions options;
          options.renderer = "law";
          options.device = client::device_profile("premium-1.5");
          options.scene = scene;
          options.stiffness_n_m = 1.5 * options.device.largest_stiffness_n_m;
          options.update_s = 0.05;
          options.model_delay_s = 0.1;
          options.law = law, options.stall_s = stall_s, options.motion = motion;
          const LiftResult result = run_lift(options);
          EXPECT_EQ(result.in_air_n, 0);
          EXPECT_GT(result.largest_n, 0.5 * options.device.largest_force_n);
          EXPECT_LE(result.over_paid, 1);
          EXPECT_GE(result.min_ledger_j, -1e-12);
          if (law == LawTold::kOne && stall_s == 0) {
            EXPECT_LE(result.over_allowed, 1.1);
            EXPECT_EQ(result.degraded_share, 0);
          }
        }
}

TEST(Felt, ChainKeepsContrastWithinATenth) {
  for (const char* renderer : {"kalman", "kalman-force"})
    for (const double stimulus_n_m : {15.0, 25.0, 30.0, 45.0}) {
      const auto felt = felt_stiffness({.renderer = renderer}, 25, stimulus_n_m, 5);
      ASSERT_EQ(felt.size(), 5u);
      for (const double felt_n_m : felt)
        EXPECT_NEAR(felt_n_m, stimulus_n_m, 0.1 * std::abs(stimulus_n_m - 25) + 0.1) << renderer;
    }
}

TEST(Trial, FewLateAnswersAreNoWorseThanTheirAge) {
  for (const Scene scene : {Scene::kHomogeneous, Scene::kInclusions}) {
    TrialOptions options;
    options.device = client::device_profile("premium-1.5");
    options.stiffness_n_m = options.device.largest_stiffness_n_m;
    options.scene = scene;
    options.update_s = 0.1;
    options.model_delay_s = 0.2;
    options.indentation_m = 0.002;
    options.rest_s = 2;
    options.safe = true;
    const TrialResult result = run_trial(options);
    EXPECT_EQ(result.verdict, Verdict::kStable);
    EXPECT_EQ(result.degraded_share, 0);
    EXPECT_LE(result.force_error, 1.2 * result.exact_law_error);
    options.model_delay_s = 0.3;
    EXPECT_GT(run_trial(options).degraded_share, 0.5);
  }
}

// Against the exact force of every tick, whose felt contrast falls with the sharpness itself.
TEST(Felt, InclusionIsFeltThrough20MillisecondsOfDelay) {
  for (const double edge_m : {0.0015, 0.002})
    for (const double stimulus_n_m : {15.0, 20.0, 37.5, 45.0}) {
      const FeltOptions exact{.renderer = "hold", .update_s = 0.001, .model_delay_s = 0, .edge_m = edge_m};
      const double exact_n_m = felt_stiffness(exact, 25, stimulus_n_m, 1).front();
      for (const double felt_n_m :
           felt_stiffness({.model_delay_s = 0.02, .edge_m = edge_m}, 25, stimulus_n_m, 5))
        EXPECT_NEAR(felt_n_m, exact_n_m, 0.05 * std::abs(stimulus_n_m - 25)) << stimulus_n_m << ' ' << edge_m;
    }
}

}  // namespace
}  // namespace teletact::bench
