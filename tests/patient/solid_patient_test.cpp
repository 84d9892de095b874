#include "client/patient/solid_patient.h"

#include <gtest/gtest.h>

#include <cmath>

namespace teletact::client {
namespace {

constexpr double kBeside = SolidPatient::kBorderM / 2 + 1e-6;

TEST(SolidPatient, HasItsLumpsInTheTissueAndItsLayersBesideThem) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    const SolidPatient patient = random_solid_patient(seed);
    for (const Lump& l : patient.lumps) {
      EXPECT_GE(l.contrast, 3);
      EXPECT_GT(l.y_m - l.radius_m, SolidPatient::kBorderM / 2) << seed;
      EXPECT_LT(std::abs(l.z_m) + l.radius_m, SolidPatient::kEndM) << seed;
      const auto over_layers = [&](double below_m) {
        return patient.modulus_pa(l.x_m, l.y_m + below_m, l.z_m) / patient.layered_pa(l.y_m + below_m);
      };
      EXPECT_NEAR(over_layers(l.radius_m - kBeside), l.contrast, 1e-9) << seed;
      EXPECT_NEAR(over_layers(l.radius_m), std::sqrt(l.contrast), 1e-9) << seed;
      EXPECT_NEAR(over_layers(l.radius_m + kBeside), 1, 1e-9) << seed;
    }
    EXPECT_NEAR(patient.layered_pa(0), patient.layers_pa[0], 1e-9);
    EXPECT_NEAR(patient.layered_pa(0.010), patient.layers_pa[1], 1e-9);
    EXPECT_NEAR(patient.layered_pa(0.040), patient.layers_pa[2], 1e-9);
  }
}

TEST(SolidPatient, IsTheSameForASeedAndAnotherForTheNext) {
  EXPECT_EQ(random_solid_patient(3).lumps[1].x_m, random_solid_patient(3).lumps[1].x_m);
  EXPECT_NE(random_solid_patient(3).lumps[1].x_m, random_solid_patient(4).lumps[1].x_m);
}

TEST(SolidPatient, ItsVolumeHoldsTheModulusOfTheElementsMiddles) {
  const SolidPatient patient = random_solid_patient(1);
  const MetaImage volume = modulus_volume(patient, {0.002, 0.001, 0.004});
  ASSERT_EQ(volume.size, (std::vector<std::size_t>{56, 40, 12}));
  EXPECT_EQ(volume.origin, (std::vector<double>{0.001, 0.0005, -0.022}));
  const std::vector<float> pa = volume.as<float>();
  EXPECT_FLOAT_EQ(pa[(7 * 40 + 11) * 56 + 20],
                  static_cast<float>(patient.modulus_pa(0.041, 0.0115, -0.022 + 7 * 0.004)));
}

}  // namespace
}  // namespace teletact::client
