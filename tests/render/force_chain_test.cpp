#include "client/render/force_chain.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

namespace teletact::client {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// In contact 4 mm deep, enabled for long, everything fresh.
ForceChainInput pressed(double force_n) {
  ForceChainInput input;
  input.rendered.force_n = Vector3(0, -force_n, 0);
  input.pose.position_m = Vector3(0.05, 0.004, 0);
  input.on = true;
  input.enabled_s = 10;
  return input;
}

double settle(ForceChain& chain, const ForceChainInput& input, int ticks = 1000) {
  for (int n = 0; n < ticks; ++n) chain.apply(input);
  return chain.last_force_n().norm();
}

// By answers as by a law, a renderer's claims are of what the gains let out: a model that softens while the
// clutch holds it back has given nothing.
TEST(ForceChain, WhatIsHeldBackByAnswersEarnsNothing) {
  ForceChain chain({});
  ForceChainInput input = pressed(0.6);
  input.rendered.stored_j = 0.001;
  settle(chain, input);
  EXPECT_EQ(chain.ledger().gain(), 1);
  input.clutched = true;
  settle(chain, input, 200);
  EXPECT_EQ(chain.last_force_n().norm(), 0);
  EXPECT_EQ(chain.ledger().gain(), 0);
}

TEST(ForceLimits, SilenceFadesFromFiftyToHundredFiftyMilliseconds) {
  const SilenceLimits limits = silence_limits(0.002);
  EXPECT_DOUBLE_EQ(limits.fade_s, 0.05);
  EXPECT_LT(limits.zero_s, 0.15 - 0.005);  // a tick and the last answer's way are still to come
  EXPECT_EQ(silence_gain(0.05, limits), 1);
  EXPECT_NEAR(silence_gain((limits.fade_s + limits.zero_s) / 2, limits), 0.5, 1e-12);
  EXPECT_EQ(silence_gain(limits.zero_s, limits), 0);
  EXPECT_EQ(silence_gain(kNaN, limits), 0);
}

TEST(ForceLimits, SilenceScalesWithTheExpectedPeriod) {
  EXPECT_DOUBLE_EQ(silence_limits(0.1).fade_s, 0.2);
  EXPECT_NEAR(silence_limits(0.1).zero_s, 0.5, 0.01);
  EXPECT_LT(silence_limits(2).zero_s, 0.5);
  EXPECT_LT(silence_limits(2).fade_s, silence_limits(2).zero_s);
  EXPECT_DOUBLE_EQ(silence_limits(kNaN).fade_s, 0.05);
}

TEST(ForceLimits, FewAnswersMayBeATenthOfASecondOlder) {
  EXPECT_DOUBLE_EQ(age_limits(0.01).degraded_s, 0.25);
  EXPECT_GT(age_limits(0.1).degraded_s, 0.3);  // 10 Hz, 0.2 s late
  EXPECT_LT(age_limits(0.1).degraded_s, 0.32);
  for (const double period_s : {0.0, 0.1, 2.0, kNaN}) {
    const AgeLimits limits = age_limits(period_s);
    EXPECT_GE(limits.degraded_s, 0.25);
    EXPECT_LE(limits.degraded_s, 0.4);
    EXPECT_DOUBLE_EQ(limits.zero_s, 0.5);
    EXPECT_EQ(age_gain(limits.degraded_s, limits), 1);
    EXPECT_NEAR(age_gain((limits.degraded_s + limits.zero_s) / 2, limits), 0.5, 1e-12);
    EXPECT_EQ(age_gain(limits.zero_s, limits), 0);
    EXPECT_EQ(age_gain(kNaN, limits), 0);
  }
}

TEST(ForceChain, PassesAnOrdinaryForceUnchanged) {
  ForceChain chain({});
  EXPECT_NEAR(settle(chain, pressed(0.6)), 0.6, 1e-12);
}

TEST(ForceChain, StaleForceFadesToZero) {
  ForceChain chain({});
  ForceChainInput input = pressed(0.6);
  settle(chain, input);
  for (double silence = 0; silence < 0.15; silence += 0.001) {
    input.silence_s = silence;
    chain.apply(input);
    if (silence < 0.05) {
      EXPECT_NEAR(chain.last_force_n().norm(), 0.6, 1e-12);
    }
  }
  EXPECT_EQ(chain.last_force_n().norm(), 0);
}

TEST(ForceChain, EvenAForceBeyondTheCeilingIsZeroAtTheEndOfTheFade) {
  ForceChainOptions options;
  ForceChain chain(options);
  ForceChainInput input = pressed(1e6);
  input.pose.position_m.y() = 0.05;  // deep: the stiffness cap allows all of it
  EXPECT_NEAR(settle(chain, input), options.limits.largest_force_n, 1e-9);
  for (double silence = 0; silence < 0.15; silence += 0.001) {
    input.silence_s = silence;
    chain.apply(input);
  }
  EXPECT_EQ(chain.last_force_n().norm(), 0);
}

TEST(ForceChain, StiffnessIsCapped) {
  ForceChainOptions options;
  options.limits.largest_stiffness_n_m = 300;
  ForceChain chain(options);
  EXPECT_NEAR(settle(chain, pressed(2)), 300 * 0.004, 1e-9);
}

TEST(ForceChain, OldModelsAreDegradedAndFaded) {
  ForceChain chain({});
  ForceChainInput input = pressed(0.6);
  input.model_age_s = 0.2;
  EXPECT_FALSE(chain.apply(input).degraded);
  input.model_age_s = 0.375;
  EXPECT_TRUE(chain.apply(input).degraded);
  EXPECT_NEAR(settle(chain, input), 0.3, 1e-9);
  input.model_age_s = 0.51;
  EXPECT_EQ(settle(chain, input), 0);
}

// GIVEN a link whose round trip is the limit, give or take a period, THEN DEGRADED does not come and go.
TEST(ForceChain, AgesAboutTheLimitDoNotFlicker) {
  ForceChain chain({});
  ForceChainInput input = pressed(0.6);
  double min_n = 1, last_n = 0;
  for (int n = 0; n < 3000; ++n) {
    input.model_age_s = 0.249 + 0.001 * (n % 4);
    const ForceChainOutput output = chain.apply(input);
    if (n < 1000) continue;
    EXPECT_TRUE(output.degraded) << n;
    if (n > 1000) min_n = std::min(min_n, output.force_n.norm() / last_n);
    last_n = output.force_n.norm();
  }
  EXPECT_GT(min_n, 0.99) << "the force is steady";
  input.model_age_s = 0.2;
  settle(chain, input, 100);
  EXPECT_FALSE(chain.apply(input).degraded);
}

TEST(ForceChain, StartsWithARamp) {
  ForceChain chain({});
  ForceChainInput input = pressed(0.6);
  input.enabled_s = 0;
  EXPECT_EQ(settle(chain, input, 3), 0);
  input.enabled_s = 0.25;
  EXPECT_NEAR(settle(chain, input), 0.3, 1e-9);
}

// However late a tick: whatever goes wrong reaches the hand at the slew limit.
TEST(ForceChain, ATickThatComesLateSlewsNoFurther) {
  ForceChainOptions options;
  for (const double dt_s : {0.05, 1e9, std::numeric_limits<double>::infinity()}) {
    ForceChain chain(options);
    ForceChainInput input = pressed(2);
    input.dt_s = dt_s;
    EXPECT_LE(chain.apply(input).force_n.norm(), options.limits.largest_slew_n_s * 0.002 + 1e-12) << dt_s;
  }
}

TEST(ForceChain, NothingIsOwedOfTheTimeBeforeAPause) {
  ForceChainOptions options;
  options.limits.largest_damping_n_s_m = 0;
  ForceChain chain(options);
  ForceChainInput input = pressed(2.0);
  input.pose.position_m.y() = 0.012;
  settle(chain, input);
  for (int n = 0; n < 8; ++n) {
    input.pose.position_m.y() -= 0.001;
    chain.apply(input);
  }
  ASSERT_LT(chain.apply(input).energy_j, -0.01);
  ASSERT_TRUE(chain.apply(input).energy_generated);
  input.on = false;
  chain.apply(input);
  input.on = true;
  const ForceChainOutput output = chain.apply(input);
  EXPECT_EQ(output.energy_j, 0);
  EXPECT_FALSE(output.degraded);
}

// The force that a debt has taken comes back only as it is paid for: a finger that rests is not pushed.
TEST(ForceChain, UnpaidGrowthIsHeldWithoutShaking) {
  ForceChain chain({});
  ForceChainInput input = pressed(0);
  for (int n = 0; n <= 100; ++n) {  // 200 N/m, slowly to 12 mm
    input.pose.position_m.y() = 0.00012 * n;
    input.rendered.force_n.y() = -200 * input.pose.position_m.y();
    input.rendered.stored_j = 100 * std::pow(input.pose.position_m.y(), 2);
    EXPECT_FALSE(chain.apply(input).degraded);
  }
  input.rendered.force_n *= 1.4;  // unpaid: 5.8 mJ
  input.rendered.stored_j *= 3;   // 29 mJ more
  EXPECT_TRUE(chain.apply(input).degraded);
  settle(chain, input, 2000);
  const double held_n = chain.last_force_n().norm();
  EXPECT_LT(held_n, 0.6 * input.rendered.force_n.norm());
  for (int n = 0; n < 2000; ++n) {
    EXPECT_FALSE(chain.apply(input).degraded);
    ASSERT_NEAR(chain.last_force_n().norm(), held_n, 0.01 * held_n);
  }
}

TEST(ForceChain, WithheldForFiftyMillisecondsIsNotDegraded) {
  ForceChain chain({});
  ForceChainInput input = pressed(0.6);
  input.rendered.withheld = 0.3;
  for (int n = 0; n < 50; ++n) EXPECT_FALSE(chain.apply(input).withholds);
  EXPECT_TRUE(chain.apply(input).withholds);
}

TEST(ForceChain, NotANumberIsZeroAndSaid) {
  ForceChain chain({});
  ForceChainInput input = pressed(0.6);
  settle(chain, input);
  input.rendered.force_n.x() = kNaN;
  EXPECT_TRUE(chain.apply(input).not_finite);
  EXPECT_EQ(settle(chain, input), 0);
}

TEST(ForceChain, RunawayIsSaidNotStepped) {
  ForceChainOptions options;
  ForceChain chain(options);
  ForceChainInput input = pressed(0.6);
  settle(chain, input);
  input.pose.velocity_m_s = Vector3(5, 0, 0);
  const Vector3 before = chain.last_force_n();
  const ForceChainOutput output = chain.apply(input);
  EXPECT_TRUE(output.too_fast);
  EXPECT_LE((output.force_n - before).norm(), options.limits.largest_slew_n_s * 0.001 + 1e-12);
}

// A display that pushes a finger which gives way: energy flows out of it.
TEST(ForceChain, GeneratedEnergyDegradesAndFades) {
  ForceChainOptions options;
  options.limits.largest_damping_n_s_m = 0;  // a controller that cannot help
  ForceChain chain(options);
  ForceChainInput input = pressed(1.0);
  input.pose.position_m.y() = 0.012;
  settle(chain, input);
  EXPECT_FALSE(chain.apply(input).degraded);
  for (int n = 0; n < 8; ++n) {  // 1 mm outwards each
    input.pose.position_m.y() = 0.012 - 0.001 * n;
    chain.apply(input);
  }
  EXPECT_TRUE(chain.apply(input).degraded);
  EXPECT_EQ(settle(chain, input, 500), 0);
  // WHEN friction has paid it back, THEN the force returns slowly
  options.limits.friction_n = 0.2;
  ForceChain rubbing(options);
  input = pressed(1.0);
  input.pose.position_m.y() = 0.012;
  settle(rubbing, input);
  for (int n = 0; n < 8; ++n) {
    input.pose.position_m.y() = 0.012 - 0.001 * n;
    input.rendered.force_n.y() = -3;
    rubbing.apply(input);
  }
  ASSERT_TRUE(rubbing.apply(input).degraded);
  input.rendered.force_n.y() = -1;
  int ticks = 0;
  for (; ticks < 5000 && rubbing.apply(input).degraded; ++ticks) input.pose.position_m.x() += 0.0001;
  EXPECT_LT(ticks, 5000);
  const double before_n = rubbing.last_force_n().norm();
  rubbing.apply(input);
  EXPECT_LE(rubbing.last_force_n().norm() - before_n, options.settle_1_s * 0.001 * 1.0 + 1e-9);
  EXPECT_NEAR(settle(rubbing, input, 3000), 1, 1e-9);
}

TEST(ForceChain, ModelTooOldNowAndThenDoesNotShake) {
  ForceChain chain({});
  ForceChainInput input = pressed(1.0);
  double low = 1e9, high = 0;
  for (int n = 0; n < 5000; ++n) {
    input.model_age_s = 0.2 + 0.001 * (n % 100);  // answers at 10 Hz, 200 ms old
    chain.apply(input);
    if (n < 3000) continue;
    low = std::min(low, chain.last_force_n().norm());
    high = std::max(high, chain.last_force_n().norm());
  }
  EXPECT_GT(low, 0.75);
  EXPECT_LT(high / low, 1.07);
}

// GIVEN a device that reports no velocity WHEN its position jumps THEN that is a runaway, whatever it says.
TEST(ForceChain, JumpOfThePositionIsTooFast) {
  ForceChain chain{ForceChainOptions()};
  ForceChainInput input;
  input.on = true;
  EXPECT_FALSE(chain.apply(input).too_fast);  // wherever it is first read
  input.pose.position_m = {0.5, 0, 0};
  EXPECT_TRUE(chain.apply(input).too_fast);
  EXPECT_FALSE(chain.apply(input).too_fast);  // it stands again
  for (int n = 0; n < 100; ++n) {             // exploring at 0.3 m/s, in samples of 100 Hz
    if (n % 10 == 0) input.pose.position_m.x() += 0.003;
    EXPECT_FALSE(chain.apply(input).too_fast);
  }
  input.pose.position_m.x() += 0.05;  // a tick that came late saw a motion, no jump
  input.dt_s = 0.06;
  EXPECT_FALSE(chain.apply(input).too_fast);
  input.dt_s = 0.001;
  input.pose.position_m.x() = NAN;
  EXPECT_TRUE(chain.apply(input).not_finite);
  input.pose.position_m.x() = 0.1;
  EXPECT_FALSE(chain.apply(input).too_fast);
}

}  // namespace
}  // namespace teletact::client
