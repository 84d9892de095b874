#include "service/imaging/modulus/modulus.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>

#include "service/imaging/modulus/strip_model.h"
#include "tests/imaging/imaging_device.h"

namespace teletact::service {
namespace {

const ImageGrid kGrid{61, 80, 0.3e-3, 0.2e-3, 0.5e-3, 0.49e-3};
constexpr double kWidthM = 0.031;

// Strain of homogeneous tissue, pushed by 0.4 mm.
struct Homogeneous {
  explicit Homogeneous(const TissueExtent& extent = {0.200, 0.040, 0.080, 0.49}) : tissue(extent) {
    StripModel model(tissue, kWidthM);
    const StripResponse response = model.solve(std::vector<double>(model.grid().elements(), 1.0));
    force_n_per_m = response.force_n_per_m;
    measured.grid = kGrid;
    for (const float strain : model.on_image(response.stress, kGrid)) {
      const float axial = 0.4e-3f * strain;
      measured.axial_strain.push_back(axial);
      measured.strain_valid.push_back(std::isfinite(axial) ? 1 : 0);
    }
  }
  ModulusInput input(std::optional<ProbeForce> force) const { return {measured, kWidthM, tissue, force, {}}; }
  // What the sensor feels for tissue of this modulus under a face 10 mm long out of plane.
  ProbeForce force(double modulus_pa) const {
    return {modulus_pa * force_n_per_m * 0.4e-3 * 0.010, kWidthM * 0.010};
  }
  TissueExtent tissue;
  double force_n_per_m = 0;
  Measured measured;
};

ReferenceStressOptions uncorrected() {
  ReferenceStressOptions options;
  options.corrections = 0;
  return options;
}

TEST(ReferenceStress, HomogeneousTissueGetsItsModulusFromTheForce) {
  const Queue queue = imaging_device()->queue();
  Homogeneous h;
  ReferenceStressOptions everywhere;
  everywhere.min_reference = 0;
  const auto method = make_reference_stress(queue, everywhere);
  const ModulusEstimate e = method->estimate(h.input(h.force(12.5e3)));
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

TEST(ReferenceStress, NothingIsSaidWhereTheProbeHardlyReaches) {
  const Queue queue = imaging_device()->queue();
  Homogeneous h;
  const ModulusEstimate e = make_reference_stress(queue, {})->estimate(h.input(h.force(12.5e3)));
  for (std::size_t i = 0; i < kGrid.nx; ++i) EXPECT_TRUE(std::isnan(e.youngs_modulus[i + kGrid.nx * 79]));
  EXPECT_NEAR(e.youngs_modulus[30 + kGrid.nx * 40], 12.5e3, 2);
}

TEST(ReferenceStress, WithoutForceTheMedianIsOne) {
  const Queue queue = imaging_device()->queue();
  Homogeneous h;
  const ModulusEstimate e = make_reference_stress(queue, {})->estimate(h.input(std::nullopt));
  EXPECT_FALSE(e.absolute);
  EXPECT_EQ(e.background, 1);
  EXPECT_NEAR(e.youngs_modulus[kGrid.size() / 2], 1, 1e-4);
}

TEST(ReferenceStress, UncorrectedHalfTheStrainIsTwiceTheModulus) {
  const Queue queue = imaging_device()->queue();
  Homogeneous h;
  for (std::size_t j = 30; j < 50; ++j)
    for (std::size_t i = 20; i < 40; ++i) h.measured.axial_strain[i + 61 * j] *= 0.5f;
  const ModulusEstimate e = make_reference_stress(queue, uncorrected())->estimate(h.input(h.force(10e3)));
  EXPECT_NEAR(e.youngs_modulus[30 + 61 * 40], 20e3, 10);
  EXPECT_NEAR(e.youngs_modulus[5 + 61 * 40], 10e3, 5);
}

// Strain of tissue with an inclusion of contrast 5, 12 mm, whose centre lies at this x of the tissue.
struct Inclusion {
  explicit Inclusion(double centre) : centre_m(centre), queue(imaging_device()->queue()) {
    StripModel model(h.tissue, kWidthM);
    std::vector<double> modulus;
    const TissueGrid& g = model.grid();
    for (std::size_t j = 0; j + 1 < g.ny(); ++j)
      for (std::size_t i = 0; i + 1 < g.nx(); ++i)
        modulus.push_back(
            truth(h.tissue.window_x_m + 0.5 * (g.x_m[i] + g.x_m[i + 1]), 0.5 * (g.y_m[j] + g.y_m[j + 1])));
    StripResponse response = model.solve(modulus);
    force = {response.force_n_per_m * 0.4e-3 * 0.010, kWidthM * 0.010};
    for (std::size_t n = 0; n < modulus.size(); ++n) response.stress[n] /= modulus[n];
    const Field strain = model.on_image(response.stress, kGrid);
    for (std::size_t n = 0; n < kGrid.size(); ++n) h.measured.axial_strain[n] = 0.4e-3f * strain[n];
  }
  double truth(double x_m, double y_m) const {
    return std::hypot(x_m - centre_m, y_m - 0.014) < 0.006 ? 50e3 : 10e3;
  }
  // Mean of |log(E / truth)| over the upper 30 mm, further than 2 mm from the inclusion's border.
  double error(const ReferenceStressOptions& options, const KnownModulus& known) {
    ModulusInput input = h.input(force);
    input.known = known;
    map = make_reference_stress(queue, options)->estimate(input).youngs_modulus;
    double sum = 0, count = 0;
    for (std::size_t n = 0; n < kGrid.size(); ++n) {
      const double x = kGrid.origin_x_m + static_cast<double>(n % kGrid.nx) * kGrid.dx_m;
      const double y = kGrid.origin_y_m + static_cast<double>(n / kGrid.nx) * kGrid.dy_m;
      const double border = std::hypot(h.tissue.window_x_m + x - centre_m, y - 0.014) - 0.006;
      if (!std::isfinite(map[n]) || y > 0.030 || std::abs(border) < 0.002) continue;
      sum += std::abs(std::log(map[n] / truth(h.tissue.window_x_m + x, y)));
      ++count;
    }
    return sum / count;
  }
  double centre_m;
  Queue queue;
  Homogeneous h;
  ProbeForce force;
  Field map;
};

TEST(ReferenceStress, CorrectionsRecoverContrastAndBackground) {
  Inclusion inside(0.095);  // the window's middle
  const std::size_t centre = 29 + 61 * 28, beside = 4 + 61 * 28;
  inside.error(uncorrected(), {});
  EXPECT_LE(inside.map[centre], 32e3);   // T3.1: (C + 1) / 2 = 3 of 5
  EXPECT_LE(inside.map[beside], 8.8e3);  // the inclusion draws the stress to itself
  inside.error({}, {});
  EXPECT_GE(inside.map[centre], 36e3);
  EXPECT_LE(inside.map[centre], 55e3);
  EXPECT_GE(inside.map[beside], 9.3e3);
  EXPECT_LE(inside.map[beside], 10.7e3);
}

ReferenceStressOptions corrected(int times) {
  ReferenceStressOptions options;
  options.corrections = times;
  return options;
}

// Multiplies the strain by 1 + noise, smooth over about the 2 mm of a strain kernel.
void add_noise(Homogeneous& h, double relative) {
  std::mt19937 random(11);
  std::normal_distribution<double> normal(0, relative);
  std::vector<double> white(kGrid.size()), smooth(kGrid.size());
  for (double& w : white) w = normal(random);
  constexpr int kHalf = 2;
  for (int j = 0; j < int(kGrid.ny); ++j)
    for (int i = 0; i < int(kGrid.nx); ++i) {
      double sum = 0, count = 0;
      for (int b = std::max(0, j - kHalf); b <= std::min(int(kGrid.ny) - 1, j + kHalf); ++b)
        for (int a = std::max(0, i - kHalf); a <= std::min(int(kGrid.nx) - 1, i + kHalf); ++a)
          sum += white[std::size_t(a) + kGrid.nx * std::size_t(b)], ++count;
      smooth[std::size_t(i) + kGrid.nx * std::size_t(j)] = sum / std::sqrt(count);
    }
  for (std::size_t n = 0; n < kGrid.size(); ++n)
    h.measured.axial_strain[n] *= static_cast<float>(1 + smooth[n]);
}

// The corrections are not a contraction: they get better, then slowly worse (T3.1), so they are few.
TEST(ReferenceStress, CorrectionsStopNearTheirBest) {
  for (const double noise : {0.0, 0.05}) {
    Inclusion inside(0.095);
    add_noise(inside.h, noise);
    std::vector<double> errors;
    std::printf("noise %.2f: mean |log E error| after 0, 1, 2, 3, 5, 10, 20 corrections", noise);
    for (const int times : {0, 1, 2, 3, 5, 10, 20}) {
      errors.push_back(inside.error(corrected(times), {}));
      std::printf(" %.3f", errors.back());
    }
    std::printf("\n");
    EXPECT_EQ(inside.error({}, {}), errors[3]);  // 3 by default
    EXPECT_LE(errors[3], 0.9 * errors[0]) << noise;
    for (const double error : errors) EXPECT_LE(errors[3], 1.05 * error) << noise;
    EXPECT_LE(errors.back(), 1.3 * errors[0]) << noise;
  }
}

TEST(ReferenceStress, NoiseInventsNoInclusionAndKeepsTheScale) {
  for (const double noise : {0.05, 0.10}) {
    const Queue queue = imaging_device()->queue();
    Homogeneous h;
    add_noise(h, noise);
    const ModulusEstimate e = make_reference_stress(queue, {})->estimate(h.input(h.force(12.5e3)));
    EXPECT_NEAR(e.background, 12.5e3, 0.05 * 12.5e3) << noise;
    double said = 0, stiff = 0;
    for (const float modulus : e.youngs_modulus)
      if (std::isfinite(modulus)) ++said, stiff += modulus > 1.5 * 12.5e3 || modulus < 12.5e3 / 1.5;
    EXPECT_GE(said, 0.8 * 0.75 * double(kGrid.size()));
    EXPECT_LE(stiff / said, 0.01) << noise;
    std::printf("noise %.2f: background %.0f of 12500 Pa, beyond 1.5 times either way %.4f\n", noise,
                e.background, stiff / said);
  }
}

// The window at the tissue's end, all of the tissue, and tissue that ends above or below the image.
TEST(ReferenceStress, AnyExtentGivesAHomogeneousModulus) {
  const Queue queue = imaging_device()->queue();
  for (const TissueExtent& extent : {TissueExtent{0.200, 0.040, 0, 0.49},
                                     {0.200, 0.040, 0.200 - kWidthM, 0.49},
                                     {kWidthM, 0.040, 0, 0.49},
                                     {0.200, 0.025, 0.080, 0.49},
                                     {0.200, 0.120, 0.080, 0.49},
                                     {0.200, 0.040, 0.080, 0.0},
                                     {0.200, 0.040, 0.080, 0.4999}}) {
    Homogeneous h(extent);
    const ModulusEstimate e = make_reference_stress(queue, {})->estimate(h.input(h.force(12.5e3)));
    EXPECT_NEAR(e.background, 12.5e3, 0.01 * 12.5e3) << extent.depth_m << " " << extent.window_x_m;
    for (std::size_t n = 0; n < kGrid.size(); ++n) {
      const double y = kGrid.origin_y_m + static_cast<double>(n / kGrid.nx) * kGrid.dy_m;
      EXPECT_TRUE(y <= extent.depth_m || std::isnan(e.youngs_modulus[n])) << n;
    }
  }
}

TEST(ReferenceStress, WhatIsKnownBesideTheWindowHelps) {
  Inclusion beside(0.073);  // 1 mm left of the window, whose near part it relieves
  const double unknown = beside.error({}, {});
  const double told = beside.error({}, {[&](double x, double y) { return beside.truth(x, y); }});
  std::printf("mean |log E error|: unknown %.3f, told %.3f\n", unknown, told);
  EXPECT_LE(told, 0.7 * unknown);
}

TEST(ReferenceStress, SaysNothingWhereItCannot) {
  const Queue queue = imaging_device()->queue();
  Homogeneous h;
  const auto block = [](std::size_t i0, std::size_t j0, auto&& change) {
    for (std::size_t j = j0; j < j0 + 7; ++j)
      for (std::size_t i = i0; i < i0 + 7; ++i) change(i + kGrid.nx * j);
  };
  block(5, 20, [&](std::size_t n) { h.measured.strain_valid[n] = 0; });
  block(20, 20, [&](std::size_t n) { h.measured.axial_strain[n] = 1e-5f; });  // too small
  block(35, 20, [&](std::size_t n) { h.measured.axial_strain[n] *= -1; });    // wrong sign
  block(50, 20,
        [&](std::size_t n) { h.measured.axial_strain[n] = std::nanf(""), h.measured.strain_valid[n] = 0; });
  const ModulusEstimate e = make_reference_stress(queue, {})->estimate(h.input(h.force(10e3)));
  for (const std::size_t i : {8u, 23u, 38u, 53u}) EXPECT_TRUE(std::isnan(e.youngs_modulus[i + 61 * 23])) << i;
  EXPECT_TRUE(std::isfinite(e.youngs_modulus[15 + 61 * 23]));
}

TEST(ReferenceStress, RefusesWhatIsNotCompressed) {
  const Queue queue = imaging_device()->queue();
  Homogeneous h;
  for (float& v : h.measured.axial_strain) v *= 1e-3f;
  EXPECT_THROW(make_reference_stress(queue, {})->estimate(h.input(std::nullopt)), NoCompression);
}

TEST(ReferenceStress, RefusesAForceByItsField) {
  const Queue queue = imaging_device()->queue();
  Homogeneous h;
  const auto method = make_reference_stress(queue, {});
  EXPECT_THROW(method->estimate(h.input(ProbeForce{-1, 6e-4})), std::invalid_argument);
  EXPECT_THROW(method->estimate(h.input(ProbeForce{1, 0})), std::invalid_argument);
}

}  // namespace
}  // namespace teletact::service
