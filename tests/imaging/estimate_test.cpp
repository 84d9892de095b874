// The imaging plane in one call: what it promises and what it refuses.
#include "service/imaging/estimate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <string>

#include "service/device/cancellation.h"
#include "tests/imaging/imaging_device.h"
#include "tests/imaging/speckle.h"

namespace teletact::service {
namespace {

constexpr double kStrain = -0.012;
constexpr std::size_t kSamples = 1039, kLines = 85;  // 20 x 20 mm

Elastography& elastography() {
  static Elastography e(imaging_device());
  return e;
}

const Speckle& tissue() {
  static const Speckle speckle = [] {
    SpeckleOptions options;
    options.samples = kSamples;
    options.lines = kLines;
    options.snr_db = 30;
    options.correlation = 0.99;
    return Speckle(options);
  }();
  return speckle;
}

RfFrame still() {
  static const RfFrame frame = tissue().frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
  return frame;
}

RfFrame pressed() {
  static const RfFrame frame = tissue().frame(
      [](double, double y) {
        return std::pair{0.0, kStrain * y};
      },
      2);
  return frame;
}

double width_m() {
  return kLines * speckle_geometry().line_pitch_m;
}
// nu = 0: uniform strain is the exact solution, so that the map must be uniform.
TissueExtent slab() {
  return {width_m(), 0.020, 0, 0.0};
}
ProbeForce force(double modulus_pa) {
  return {modulus_pa * -kStrain * width_m() * 0.010, width_m() * 0.010};
}

TEST(Elastography, AnUnsolvedRefinementIsTold) {
  ElastographyOptions options;
  options.displacement.refinement.max_iterations = 1;
  const auto warned = [&] {
    const Estimate e = Elastography(imaging_device(), options)
                           .estimate(still(), pressed(), {speckle_geometry(), force(10e3), slab()});
    return std::any_of(e.input_warnings.begin(), e.input_warnings.end(), [](const Warning& w) {
      return w.text.find("unsolved after 1 iterations") < w.text.size();
    });
  };
  EXPECT_TRUE(warned());
  options = {};
  EXPECT_FALSE(warned());
}

TEST(Elastography, UniformTissueGetsItsModulus) {
  const Estimate e = elastography().estimate(still(), pressed(), {speckle_geometry(), force(10e3), slab()});
  EXPECT_TRUE(e.modulus.absolute);
  EXPECT_NEAR(e.modulus.background, 10e3, 150);
  EXPECT_NEAR(e.modulus.mean_axial_strain, kStrain, 1e-4);
  EXPECT_GE(e.median_correlation, 0.95);
  EXPECT_GE(e.valid_fraction, 0.85);
  EXPECT_GE(e.quality, 0.9);
  EXPECT_LE(e.quality, 1);
  std::size_t off = 0;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    EXPECT_EQ(e.valid[n] != 0, std::isfinite(e.modulus.youngs_modulus[n]));
    EXPECT_LE(e.valid[n], e.strain_valid[n]);
    EXPECT_LE(e.strain_valid[n], e.displacement_valid[n]);
    off += e.valid[n] && std::abs(e.modulus.youngs_modulus[n] - 10e3) > 1.5e3;
  }
  EXPECT_LE(off, e.grid.size() / 50);
}

TEST(Elastography, WithoutForceTheModulusIsRelative) {
  const Estimate e = elastography().estimate(still(), pressed(), {speckle_geometry(), std::nullopt, slab()});
  EXPECT_FALSE(e.modulus.absolute);
  EXPECT_EQ(e.modulus.background, 1);
}

// GIVEN time for one step, THEN that is decided before the first, and the modulus is said to be unsettled.
TEST(Elastography, AsksForItsBudgetOnce) {
  const RfFrame layered = tissue().frame(
      [](double, double y) {
        return std::pair{0.0, kStrain * (y < 0.010 ? y : 0.010 + (y - 0.010) / 3)};
      },
      2);
  EstimateInput in{speckle_geometry(), force(10e3), slab()};
  in.modulus.kind = ModulusKind::kIterative;
  const int settled = elastography().estimate(still(), layered, in).modulus.iterations;
  ASSERT_GE(settled, 2);
  int asked = 0;
  in.b_mode = true;
  in.modulus.budget = [&] { return ModulusBudget{.steps = ++asked}; };
  const Estimate e = elastography().estimate(still(), layered, in);
  EXPECT_EQ(asked, 1);
  EXPECT_EQ(e.modulus.iterations, 1);
  EXPECT_FALSE(e.modulus.converged);
  EXPECT_EQ(e.modulus.kind, ModulusKind::kIterative);
  EXPECT_GT(e.modulus.start_s, 0);
  EXPECT_LT(e.modulus.start_s, e.modulus_s);
  EXPECT_EQ(e.b_mode.grey.size(), e.b_mode.grid.size());
  EXPECT_EQ(e.b_mode.grid.nx, layered.line_count);
}

TEST(Elastography, StagesEndInOrder) {
  std::vector<Stage> stages;
  const Estimate e = elastography().estimate(still(), pressed(), {speckle_geometry(), std::nullopt, slab()},
                                             [&](Stage s) { stages.push_back(s); });
  EXPECT_EQ(stages, (std::vector{Stage::kDisplacement, Stage::kStrain, Stage::kModulus}));
  EXPECT_TRUE(e.b_mode.grey.empty()) << "nobody wants it";
}

TEST(Elastography, CancelledWorkStops) {
  int asked = 0;
  struct Cancelled {};
  const CancellationCheck second([&] {
    if (++asked >= 2) throw Cancelled();
  });
  EXPECT_THROW(elastography().estimate(still(), pressed(), {speckle_geometry(), std::nullopt, slab()}),
               Cancelled);
  EXPECT_EQ(asked, 2);
}

TEST(Elastography, IsTheSameToTheBitWhetherItIsLookedAfterOrNot) {
  const auto estimate = [] {
    return elastography().estimate(
        still(), pressed(), {speckle_geometry(), std::nullopt, slab(), {}, {ModulusKind::kDirect, {}}});
  };
  const Estimate alone = estimate();
  int asked = 0;
  const CancellationCheck look([&] { ++asked; });
  const Estimate looked_after = estimate();
  EXPECT_GT(asked, 100);
  const auto same = [](const Field& a, const Field& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
  };
  EXPECT_TRUE(same(alone.axial_displacement, looked_after.axial_displacement));
  EXPECT_TRUE(same(alone.axial_displacement_std, looked_after.axial_displacement_std));
  EXPECT_TRUE(same(alone.correlation, looked_after.correlation));
  EXPECT_TRUE(same(alone.axial_strain, looked_after.axial_strain));
  EXPECT_TRUE(same(alone.modulus.youngs_modulus, looked_after.modulus.youngs_modulus));
}

TEST(Elastography, MaxStrainCanBeAnotherFromPairToPair) {
  Elastography one(imaging_device());
  const auto displacement = [](Elastography& e, double max_strain) {
    e.set_max_strain(max_strain);
    return e
        .estimate(still(), pressed(),
                  {speckle_geometry(), std::nullopt, slab(), {}, {ModulusKind::kReferenceStress, {}}})
        .axial_displacement;
  };
  const Field usual = displacement(one, 0.05), wide = displacement(one, 0.1);
  EXPECT_EQ(displacement(one, 0.05), usual);
  Elastography fresh(imaging_device());
  EXPECT_EQ(displacement(fresh, 0.1), wide);
  EXPECT_THROW(one.set_max_strain(0.2), std::invalid_argument);
}

// `words`: that its message has.
TrackingError::Reason refusal(const RfFrame& pre, const RfFrame& post, const std::string& words = "") {
  try {
    elastography().estimate(pre, post, {speckle_geometry(), std::nullopt, slab()});
  } catch (const TrackingError& e) {
    EXPECT_NE(std::string(e.what()).find(words), std::string::npos) << e.what();
    return e.reason;
  }
  throw std::logic_error("the pair was not refused");
}

TEST(Elastography, UnrelatedFramesAreRefused) {
  SpeckleOptions options;
  options.samples = kSamples;
  options.lines = kLines;
  options.seed = 99;
  const RfFrame other = Speckle(options).frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
  EXPECT_EQ(refusal(still(), other,
                    " is below 0.60; the frames are unrelated, or moved out of plane, or strained beyond 0.1 "
                    "(searched up to that; max_strain is 0.05): take the pair again"),
            TrackingError::Reason::kDecorrelated);
}

TEST(Elastography, RefusesCompressionBeyondTheSearch) {
  const RfFrame far = tissue().frame([](double, double y) { return std::pair{0.0, -0.09 * y}; }, 2);
  EXPECT_EQ(
      refusal(still(), far, "with max_strain 0.1: it is strained beyond max_strain 0.05; compress less"),
      TrackingError::Reason::kBeyondSearch);
  ElastographyOptions wide;
  wide.displacement.max_strain = 0.1;
  const Estimate e =
      Elastography(imaging_device(), wide).estimate(still(), far, {speckle_geometry(), std::nullopt, slab()});
  EXPECT_NEAR(e.modulus.mean_axial_strain, -0.09, 0.002);
  EXPECT_GE(e.quality, 0.8);
}

// A patch whose scatterers were replaced (blood, out-of-plane motion) is masked and its error is said to be
// large.
TEST(Elastography, DecorrelatedPatchIsMasked) {
  SpeckleOptions options;
  options.samples = kSamples;
  options.lines = kLines;
  options.seed = 99;
  const RfFrame other = Speckle(options).frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
  RfFrame post = pressed();
  const auto patch = [](double sample, double line) {
    return std::hypot(sample - 520, (line - 42) * 12.2) < 200;
  };
  for (std::size_t l = 0; l < kLines; ++l)
    for (std::size_t k = 0; k < kSamples; ++k)
      if (patch(static_cast<double>(k), static_cast<double>(l)))
        post.samples[k + kSamples * l] = other.samples[k + kSamples * l];
  const Estimate e = elastography().estimate(still(), post, {speckle_geometry(), std::nullopt, slab()});
  const Estimate whole =
      elastography().estimate(still(), pressed(), {speckle_geometry(), std::nullopt, slab()});
  EXPECT_LT(e.quality, whole.quality);
  double inside = 0, wrong = 0, outside = 0, lost = 0, doubted = 0;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    const double y = e.grid.origin_y_m + static_cast<double>(n / e.grid.nx) * e.grid.dy_m;
    const double x = e.grid.origin_x_m + static_cast<double>(n % e.grid.nx) * e.grid.dx_m;
    const double r =
        std::hypot(y - 520 * speckle_geometry().sample_pitch_m(), x - 42.5 * speckle_geometry().line_pitch_m);
    if (r < 2.3e-3) {
      ++inside, wrong += e.valid[n];
      doubted += e.axial_displacement_std[n] > 5 * whole.axial_displacement_std[n];
    } else if (r > 6e-3 && whole.valid[n]) {
      ++outside, lost += !e.valid[n];
    }
  }
  EXPECT_LE(wrong, 0.02 * inside);
  EXPECT_GE(doubted, 0.8 * inside);
  EXPECT_LE(lost, 0.05 * outside);
}

// Cysts and shadows: nothing is heard, so nothing is said.
TEST(Elastography, ShadowIsMasked) {
  RfFrame pre = still(), post = pressed();
  for (std::size_t l = 30; l < 50; ++l)
    for (std::size_t k = 400; k < kSamples; ++k)
      pre.samples[k + kSamples * l] = post.samples[k + kSamples * l] = 0;
  const Estimate e = elastography().estimate(
      pre, post, {speckle_geometry(), std::nullopt, slab(), {}, {ModulusKind::kIterative, 60.0}});
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    const double line = (e.grid.origin_x_m + static_cast<double>(n % e.grid.nx) * e.grid.dx_m) /
                            speckle_geometry().line_pitch_m -
                        0.5;
    const double sample = (e.grid.origin_y_m + static_cast<double>(n / e.grid.nx) * e.grid.dy_m) /
                          speckle_geometry().sample_pitch_m();
    if (line > 35 && line < 45 && sample > 450) {
      EXPECT_EQ(e.valid[n], 0) << line << " " << sample;
    }
    // What is trusted beside it has a deviation, so that the modulus can weigh it.
    if (e.displacement_valid[n]) {
      EXPECT_TRUE(std::isfinite(e.axial_displacement_std[n])) << line << " " << sample;
      EXPECT_TRUE(std::isfinite(e.lateral_displacement_std[n])) << line << " " << sample;
    }
  }
  EXPECT_GE(e.modulus.iterations, 1);
}

TEST(Elastography, SwappedFramesShowAsExtension) {
  const Estimate e = elastography().estimate(pressed(), still(), {speckle_geometry(), std::nullopt, slab()});
  EXPECT_NEAR(e.modulus.mean_axial_strain, -kStrain, 2e-4);
}

TEST(Elastography, FramesWithoutCompressionAreRefused) {
  EXPECT_EQ(refusal(still(), still()), TrackingError::Reason::kNoCompression);
}

TEST(Elastography, SilentFramesAreRefused) {
  const RfFrame silent{kSamples, kLines, std::vector<float>(kSamples * kLines, 0.0f)};
  EXPECT_EQ(refusal(silent, silent), TrackingError::Reason::kNoSignal);
}

// The message of the refusal, which must name the field.
std::string invalid(const RfFrame& pre, const RfFrame& post, const AcquisitionGeometry& geometry,
                    const std::optional<ProbeForce>& force = std::nullopt,
                    const TissueExtent& extent = slab()) {
  try {
    elastography().estimate(pre, post, {geometry, force, extent});
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "not refused";
}

TEST(Elastography, RefusesBadGeometryByItsField) {
  const auto with = [](auto&& change) {
    AcquisitionGeometry g = speckle_geometry();
    change(g);
    return invalid(still(), pressed(), g);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(with([](auto& g) { g.sampling_frequency_hz = 0; }).find("sampling_frequency_hz"),
            std::string::npos);
  EXPECT_NE(with([](auto& g) { g.sampling_frequency_hz = 14e6; }).find("sampling_frequency_hz"),
            std::string::npos);
  EXPECT_NE(with([=](auto& g) { g.center_frequency_hz = nan; }).find("center_frequency_hz"),
            std::string::npos);
  EXPECT_NE(with([](auto& g) { g.line_pitch_m = 0; }).find("line_pitch_m"), std::string::npos);
  EXPECT_NE(with([](auto& g) { g.sound_speed_m_s = 1.54; }).find("sound_speed_m_s"), std::string::npos);
  EXPECT_NE(with([](auto& g) { g.first_sample_depth_m = -1; }).find("first_sample_depth_m"),
            std::string::npos);
}

TEST(Elastography, RefusesBadFramesByTheirField) {
  RfFrame nan = pressed(), infinite = pressed(), shorter = pressed(), truncated = pressed(), tiny{8, 2, {}};
  nan.samples[1000] = std::numeric_limits<float>::quiet_NaN();
  infinite.samples.back() = std::numeric_limits<float>::infinity();
  shorter.sample_count -= 1;
  truncated.samples.pop_back();
  tiny.samples.resize(16);
  const AcquisitionGeometry g = speckle_geometry();
  EXPECT_NE(invalid(still(), nan, g).find("post.samples"), std::string::npos);
  EXPECT_NE(invalid(infinite, pressed(), g).find("pre.samples"), std::string::npos);
  EXPECT_NE(invalid(still(), shorter, g).find("post"), std::string::npos);
  EXPECT_NE(invalid(still(), truncated, g).find("post.samples"), std::string::npos);
  EXPECT_NE(invalid(tiny, tiny, g).find("sample_count"), std::string::npos);
}

TEST(Elastography, RefusesBadForceAndTissueByTheirField) {
  const AcquisitionGeometry g = speckle_geometry();
  TissueExtent outside = slab();
  outside.window_x_m = 0.005;
  EXPECT_NE(invalid(still(), pressed(), g, ProbeForce{0, 1e-4}).find("force_n"), std::string::npos);
  EXPECT_NE(invalid(still(), pressed(), g, std::nullopt, outside).find("window_x_m"), std::string::npos);
}

}  // namespace
}  // namespace teletact::service
