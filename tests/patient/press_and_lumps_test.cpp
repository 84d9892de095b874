#include <gtest/gtest.h>

#include "client/patient/patient.h"

namespace teletact::client {
namespace {

// Across the image plane the probe is twice as wide as what is felt of the tissue.
TEST(Press, ForceIsOfTheProbesElevation) {
  Tissue tissue;
  tissue.width_m = .05, tissue.depth_m = .03, tissue.poisson_ratio = 0;
  tissue.thickness_m = .010;
  tissue.probe.width_m = tissue.width_m, tissue.probe.elevation_m = .020;
  const Patient patient(tissue, .005);
  EXPECT_NEAR(patient.press(0, 3e-4).force_n, tissue.youngs_modulus_pa * 3e-4 / .03 * .05 * .020, 1e-9);
}

TEST(Tissue, OverlappingLumpsAreTheLaterOne) {
  Tissue tissue;
  tissue.inclusions = {{.100, .02, .01, 5}, {.104, .02, .01, 5}, {.108, .02, .01, 3}};
  EXPECT_EQ(tissue.true_modulus(.102, .02), 50e3);
  EXPECT_EQ(tissue.true_modulus(.106, .02), 30e3);
}

}  // namespace
}  // namespace teletact::client
