// What the safety chain's smallest parts promise of themselves.
#include <gtest/gtest.h>

#include <limits>
#include <utility>
#include <vector>

#include "client/render/force_limits.h"
#include "client/render/renderer.h"

namespace teletact::client {
namespace {

TEST(ForceSample, IsFiniteInEveryFieldThatARendererReads) {
  ForceSample sample;
  EXPECT_TRUE(is_finite(sample));
  std::vector<double*> fields{&sample.pose_time_s, &sample.surface.offset_m};
  for (Vector3* vector : {&sample.position_m, &sample.force_n, &sample.surface.normal})
    for (double& component : *vector) fields.push_back(&component);
  for (double& component : sample.tangent_n_m.reshaped()) fields.push_back(&component);
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
  EXPECT_LE((cap_rise(Vector3(0, 1, 0), Vector3(0, 2, 0), kRiseN) - Vector3(0, 1, 0)).norm(), 1e-15);
  EXPECT_LE((cap_rise(Vector3(0, -3, 0), Vector3(0, 2, 0), kRiseN) - Vector3(0, -0.5, 0)).norm(), 1e-15);
  EXPECT_LE((cap_rise(Vector3(-3, 4, 0), Vector3(3, 4, 0), kRiseN) - Vector3(-0.5, 4, 0)).norm(), 1e-15);
  EXPECT_LE((cap_rise(Vector3(0, 3, 0), Vector3(0, 2, 0), kRiseN) - Vector3(0, 2.5, 0)).norm(), 1e-15);
}

TEST(ForceLimits, AMagnitudeIsCutAlongItsDirection) {
  EXPECT_LE((cap_magnitude({3, -4, 0}, 2.5) - Vector3(1.5, -2, 0)).norm(), 1e-12);
  EXPECT_EQ(cap_magnitude({3, -4, 0}, 5), Vector3(3, -4, 0));
  EXPECT_EQ(cap_stiffness({3, -4, 0}, -0.001, 800).norm(), 0);
  EXPECT_NEAR(cap_stiffness({3, -4, 0}, 0.001, 800).norm(), 0.8, 1e-12);
  EXPECT_LE((cap_slew({0, 0, 0}, {3, -4, 0}, 100, 0.01) - Vector3(2.4, -3.2, 0)).norm(), 1e-12);
}

}  // namespace
}  // namespace teletact::client
