// What the safety chain's smallest parts promise of themselves.
#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <utility>

#include "client/render/force_limits.h"
#include "client/render/renderer.h"

namespace teletact::client {
namespace {

TEST(ForceSample, IsFiniteInEveryFieldThatARendererReads) {
  ForceSample sample;
  EXPECT_TRUE(is_finite(sample));
  const std::array fields{&sample.pose_time_s,       &sample.position_m.x(),    &sample.position_m.y(),
                          &sample.force_n.x(),       &sample.force_n.y(),       &sample.tangent_n_m(0, 0),
                          &sample.tangent_n_m(0, 1), &sample.tangent_n_m(1, 0), &sample.tangent_n_m(1, 1),
                          &sample.surface_m};
  for (double* field : fields)
    for (const double bad :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
      const double good = std::exchange(*field, bad);
      EXPECT_FALSE(is_finite(sample));
      *field = good;
    }
  EXPECT_TRUE(is_finite(sample));
}

// Nothing holds a force up that falls; what rises beyond the least on the way is limited.
TEST(ForceLimits, AForceThatTurnsFallsAtOnceAndRisesByTheLimit) {
  constexpr double kRiseN = 0.5;
  EXPECT_LE((cap_rise(Vector2(0, 1), Vector2(0, 2), kRiseN) - Vector2(0, 1)).norm(), 1e-15);
  EXPECT_LE((cap_rise(Vector2(0, -3), Vector2(0, 2), kRiseN) - Vector2(0, -0.5)).norm(), 1e-15);
  EXPECT_LE((cap_rise(Vector2(-3, 4), Vector2(3, 4), kRiseN) - Vector2(-0.5, 4)).norm(), 1e-15);
  EXPECT_LE((cap_rise(Vector2(0, 3), Vector2(0, 2), kRiseN) - Vector2(0, 2.5)).norm(), 1e-15);
}

TEST(ForceLimits, AMagnitudeIsCutAlongItsDirection) {
  EXPECT_LE((cap_magnitude({3, -4}, 2.5) - Vector2(1.5, -2)).norm(), 1e-12);
  EXPECT_EQ(cap_magnitude({3, -4}, 5), Vector2(3, -4));
  EXPECT_EQ(cap_stiffness({3, -4}, -0.001, 800).norm(), 0);
  EXPECT_NEAR(cap_stiffness({3, -4}, 0.001, 800).norm(), 0.8, 1e-12);
  EXPECT_LE((cap_slew({0, 0}, {3, -4}, 100, 0.01) - Vector2(2.4, -3.2)).norm(), 1e-12);
}

}  // namespace
}  // namespace teletact::client
