#include "service/imaging/modulus.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "service/imaging/homogeneous.h"
#include "tests/imaging/imaging_device.h"

namespace teletact::service {
namespace {

const ImageGrid kGrid{61, 80, 0.3e-3, 0.2e-3, 0.5e-3, 0.49e-3};
constexpr double kWidthM = 0.031;

// nu = 0 and a window as wide as the tissue: plain compression, eps = -1 / depth, P = E width / depth.
TEST(HomogeneousResponse, IsPlainCompressionWithoutPoissonEffect) {
  const auto r = homogeneous_response({kWidthM, 0.040, 0, 0.0}, kWidthM, kGrid);
  EXPECT_NEAR(r.force_n_per_m, kWidthM / 0.040, 1e-9);
  for (const float strain : r.axial_strain) EXPECT_NEAR(strain, -25, 1e-4);
}

// Bonded below and nearly incompressible, a wide layer is stiffer than E width / depth; context stiffens
// further.
TEST(HomogeneousResponse, BondedBaseAndContextStiffen) {
  const double alone = homogeneous_response({0.060, 0.040, 0, 0.49}, 0.060, kGrid).force_n_per_m;
  const double inside = homogeneous_response({0.300, 0.040, 0.120, 0.49}, 0.060, kGrid).force_n_per_m;
  const double side = homogeneous_response({0.300, 0.040, 0, 0.49}, 0.060, kGrid).force_n_per_m;
  EXPECT_GT(alone, 1.05 * 0.060 / 0.040);
  EXPECT_GT(side, 1.1 * alone);
  EXPECT_GT(inside, 1.1 * side);
}

TEST(HomogeneousResponse, NothingIsSaidBelowTheTissue) {
  const auto r = homogeneous_response({kWidthM, 0.020, 0, 0.49}, kWidthM, kGrid);
  EXPECT_TRUE(std::isfinite(r.axial_strain[61 * 30]));
  EXPECT_TRUE(std::isnan(r.axial_strain[61 * 60]));
}

TEST(HomogeneousResponse, RefusesAnExtentByItsField) {
  const auto refused = [](const TissueExtent& t, const char* field) {
    try {
      homogeneous_response(t, kWidthM, kGrid);
    } catch (const std::invalid_argument& e) {
      return std::string(e.what()).find(field) != std::string::npos;
    }
    return false;
  };
  EXPECT_TRUE(refused({kWidthM, 0, 0, 0.49}, "depth_m"));
  EXPECT_TRUE(refused({kWidthM, 0.04, 0, 0.5}, "poisson_ratio"));
  EXPECT_TRUE(refused({kWidthM, 0.04, 0, std::nan("")}, "poisson_ratio"));
  EXPECT_TRUE(refused({kWidthM, 0.04, 0.001, 0.49}, "window_x_m"));
  EXPECT_TRUE(refused({kWidthM, 0.04, -0.001, 0.49}, "window_x_m"));
}

TEST(HomogeneousCache, WindowsWithTheSameContextShareOneSolve) {
  HomogeneousCache cache;
  const auto a = cache.get({0.300, 0.040, 0.090, 0.49}, kWidthM, kGrid);
  EXPECT_EQ(a, cache.get({0.300, 0.040, 0.120, 0.49}, kWidthM, kGrid));
  EXPECT_NE(a, cache.get({0.300, 0.040, 0, 0.49}, kWidthM, kGrid));
  EXPECT_NE(a, cache.get({0.300, 0.041, 0.120, 0.49}, kWidthM, kGrid));
}

// Strain of homogeneous tissue, pushed by 0.4 mm.
struct Homogeneous {
  Homogeneous() : response(homogeneous_response(tissue, kWidthM, kGrid)) {
    for (const float strain : response.axial_strain) {
      const float axial = 0.4e-3f * strain;
      tensor.insert(tensor.end(), {-axial, axial, 0, 0});
      trusted.push_back(1);
    }
  }
  ModulusInput input(const Queue& queue, std::optional<ProbeForce> force) {
    estimate = {queue.array(tensor), queue.array(trusted)};
    return {kGrid, displacement, estimate, kWidthM, tissue, force};
  }
  // What the sensor feels for tissue of this modulus under a face 10 mm long out of plane.
  ProbeForce force(double modulus_pa) const {
    return {modulus_pa * response.force_n_per_m * 0.4e-3 * 0.010, kWidthM * 0.010};
  }
  TissueExtent tissue{0.200, 0.040, 0.080, 0.49};
  HomogeneousResponse response;
  std::vector<float> tensor;
  std::vector<std::uint8_t> trusted;
  DisplacementEstimate displacement;
  StrainEstimate estimate;
};

TEST(ReferenceStress, HomogeneousTissueGetsItsModulusFromTheForce) {
  const Queue queue = imaging_device()->queue();
  Homogeneous h;
  const auto method = make_reference_stress(queue, {});
  const ModulusEstimate e = method->estimate(h.input(queue, h.force(12.5e3)));
  EXPECT_TRUE(e.absolute);
  EXPECT_NEAR(e.background, 12.5e3, 1);
  EXPECT_LT(e.mean_axial_strain, -0.005);
  for (std::size_t n = 0; n < kGrid.size(); ++n) {
    const bool near_field = kGrid.origin_y_m + static_cast<double>(n / kGrid.nx) * kGrid.dy_m < 1e-3;
    EXPECT_EQ(near_field, std::isnan(e.youngs_modulus[n])) << n;
    if (near_field) continue;
    EXPECT_NEAR(e.youngs_modulus[n], 12.5e3, 2) << n;
  }
}

TEST(ReferenceStress, WithoutForceTheMedianIsOne) {
  const Queue queue = imaging_device()->queue();
  Homogeneous h;
  const ModulusEstimate e = make_reference_stress(queue, {})->estimate(h.input(queue, std::nullopt));
  EXPECT_FALSE(e.absolute);
  EXPECT_EQ(e.background, 1);
  EXPECT_NEAR(e.youngs_modulus[kGrid.size() / 2], 1, 1e-4);
}

TEST(ReferenceStress, HalfTheStrainIsTwiceTheModulus) {
  const Queue queue = imaging_device()->queue();
  Homogeneous h;
  for (std::size_t j = 30; j < 50; ++j)
    for (std::size_t i = 20; i < 40; ++i) h.tensor[4 * (i + 61 * j) + 1] *= 0.5f;
  const ModulusEstimate e = make_reference_stress(queue, {})->estimate(h.input(queue, h.force(10e3)));
  EXPECT_NEAR(e.youngs_modulus[30 + 61 * 40], 20e3, 10);
  EXPECT_NEAR(e.youngs_modulus[5 + 61 * 40], 10e3, 5);
}

TEST(ReferenceStress, SaysNothingWhereItCannot) {
  const Queue queue = imaging_device()->queue();
  Homogeneous h;
  const auto block = [](std::size_t i0, std::size_t j0, auto&& change) {
    for (std::size_t j = j0; j < j0 + 7; ++j)
      for (std::size_t i = i0; i < i0 + 7; ++i) change(i + kGrid.nx * j);
  };
  block(5, 20, [&](std::size_t n) { h.trusted[n] = 0; });
  block(20, 20, [&](std::size_t n) { h.tensor[4 * n + 1] = 1e-5f; });  // too small
  block(35, 20, [&](std::size_t n) { h.tensor[4 * n + 1] *= -1; });    // wrong sign
  block(50, 20, [&](std::size_t n) { h.tensor[4 * n + 1] = std::nanf(""), h.trusted[n] = 0; });
  const ModulusEstimate e = make_reference_stress(queue, {})->estimate(h.input(queue, h.force(10e3)));
  for (const std::size_t i : {8u, 23u, 38u, 53u}) EXPECT_TRUE(std::isnan(e.youngs_modulus[i + 61 * 23])) << i;
  EXPECT_TRUE(std::isfinite(e.youngs_modulus[15 + 61 * 23]));
}

TEST(ReferenceStress, RefusesWhatIsNotCompressed) {
  const Queue queue = imaging_device()->queue();
  Homogeneous h;
  for (float& v : h.tensor) v *= 1e-3f;
  EXPECT_THROW(make_reference_stress(queue, {})->estimate(h.input(queue, std::nullopt)), NoCompression);
}

TEST(ReferenceStress, RefusesAForceByItsField) {
  const Queue queue = imaging_device()->queue();
  Homogeneous h;
  const auto method = make_reference_stress(queue, {});
  EXPECT_THROW(method->estimate(h.input(queue, ProbeForce{-1, 6e-4})), std::invalid_argument);
  EXPECT_THROW(method->estimate(h.input(queue, ProbeForce{1, 0})), std::invalid_argument);
}

}  // namespace
}  // namespace teletact::service
