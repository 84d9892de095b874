#include "client/render/force_chain.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "client/render/hold_renderer.h"
#include "client/render/kalman_renderer.h"

namespace teletact::client {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// In contact 4 mm deep, enabled for long, everything fresh.
ForceChainInput pressed(double force_n) {
  ForceChainInput input;
  input.rendered.force_n = Vector2(0, -force_n);
  input.pose.position_m = Vector2(0.05, 0.004);
  input.on = true;
  input.enabled_s = 10;
  return input;
}

double settle(ForceChain& chain, const ForceChainInput& input, int ticks = 1000) {
  for (int n = 0; n < ticks; ++n) chain.apply(input);
  return chain.last_force_n().norm();
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

TEST(ForceLimits, SilenceScalesWithTheNegotiatedPeriodUpToHalfASecond) {
  EXPECT_DOUBLE_EQ(silence_limits(0.1).fade_s, 0.2);
  EXPECT_NEAR(silence_limits(0.1).zero_s, 0.5, 0.01);
  EXPECT_LT(silence_limits(2).zero_s, 0.5);
  EXPECT_LT(silence_limits(2).fade_s, silence_limits(2).zero_s);
  EXPECT_DOUBLE_EQ(silence_limits(kNaN).fade_s, 0.05);
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

TEST(ForceChain, StartsWithARamp) {
  ForceChain chain({});
  ForceChainInput input = pressed(0.6);
  input.enabled_s = 0;
  EXPECT_EQ(settle(chain, input, 3), 0);
  input.enabled_s = 0.25;
  EXPECT_NEAR(settle(chain, input), 0.3, 1e-9);
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
  input.pose.velocity_m_s = Vector2(5, 0);
  const Vector2 before = chain.last_force_n();
  const ForceChainOutput output = chain.apply(input);
  EXPECT_TRUE(output.too_fast);
  EXPECT_LE((output.force_n - before).norm(), options.limits.largest_slew_n_s * 0.001 + 1e-12);
}

// Any stream of answers whatever: bounded, finite, no step beyond the slew.
TEST(ForceChain, BoundsHoldForAnyStream) {
  std::mt19937_64 random(20240611);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto wild = [&]() -> double {
    switch (random() % 8) {
      case 0:
        return kNaN;
      case 1:
        return kInfinity * uniform(random);
      case 2:
        return 1e300 * uniform(random);
      case 3:
        return 0;
      default:
        return std::pow(10, 4 * uniform(random)) * uniform(random);
    }
  };
  ForceChainOptions options;
  ForceChain chain(options);
  KalmanRenderer kalman;
  HoldRenderer hold;
  const ForceLimits& limits = options.limits;
  Vector2 last = Vector2::Zero();
  for (int n = 0; n < 100000; ++n) {
    const bool tame = random() % 2 == 0;
    const auto number = [&](double scale) { return tame ? scale * uniform(random) : wild(); };
    ForceSample sample;
    sample.position_m = Vector2(number(0.1), number(0.01));
    sample.force_n = Vector2(number(5), number(5));
    sample.tangent_n_m << number(500), number(500), number(500), number(500);
    sample.pose_time_s = number(10);
    sample.contact = random() % 4 != 0;
    ForceChainInput input;
    input.pose.position_m = Vector2(uniform(random) * 0.1, uniform(random) * 0.02);
    input.pose.velocity_m_s = Vector2(number(0.3), number(0.3));
    if (random() % 50 == 0) input.pose.position_m.y() = wild();
    Renderer& renderer = n % 2000 < 1000 ? static_cast<Renderer&>(kalman) : hold;
    if (is_finite(sample)) renderer.update(sample, input.pose, 1e-3 * n);
    input.rendered = renderer.render(input.pose, 1e-3 * n);
    if (random() % 10 == 0) input.rendered.force_n = Vector2(wild(), wild());
    input.on = random() % 10 != 0;
    input.enabled_s = number(2);
    input.silence_s = number(0.1);
    input.model_age_s = number(0.3);
    input.period_s = number(0.01);
    input.dt_s = random() % 20 == 0 ? wild() : 0.001;
    const Vector2 force = chain.apply(input).force_n;
    ASSERT_TRUE(force.allFinite()) << n;
    ASSERT_LE(force.norm(), limits.largest_force_n * (1 + 1e-12)) << n;
    const double dt_s = std::isfinite(input.dt_s) ? std::clamp(input.dt_s, 0.0, 0.002) : 0;
    ASSERT_LE((force - last).norm(), limits.largest_slew_n_s * dt_s + 1e-12) << n;
    last = force;
  }
}

}  // namespace
}  // namespace teletact::client
