// Windows of solid tissue under a narrow probe: truth and RF come from the patient's own finite elements in
// three dimensions, with sides, supports and friction that the estimate does not have. One file: its cases
// look at windows that are pressed once, a second each.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "client/patient/rf.h"
#include "client/patient/solid_press.h"
#include "service/imaging/estimate.h"
#include "tests/imaging/imaging_device.h"

namespace teletact::service {
namespace {

constexpr double kPushM = 0.0008, kBackgroundPa = 10e3;
// Of the truth's elements along x, by the fourth power of which it costs time: enough for all but a lump's
// contrast.
constexpr double kSpacingM = 0.0025, kFineSpacingM = 0.002;
constexpr double kProbeM = 0.060, kElevationM = 0.010;

struct Lump {
  double y_m, contrast;
  bool sphere;
};

client::Tissue tissue(const client::Solid& solid = {}, double width_m = 0.120,
                      std::optional<Lump> lump = std::nullopt) {
  client::Tissue t;
  t.width_m = width_m, t.youngs_modulus_pa = kBackgroundPa, t.solid = solid;
  t.probe.width_m = kProbeM, t.probe.elevation_m = kElevationM;
  if (lump) {
    client::Inclusion inclusion;
    inclusion.x_m = width_m / 2, inclusion.y_m = lump->y_m, inclusion.diameter_m = 0.010;
    inclusion.contrast = lump->contrast, inclusion.sphere = lump->sphere;
    t.inclusions.push_back(inclusion);
  }
  return t;
}

struct Asked {
  Plane plane = Plane::kSolid;
  bool force = true, depth = true;
  int solves = ModulusBudget::kAll;
  double stated_depth_m = 0.040, elevation_m = 0, elevation_std_m = 0;
  std::optional<StandoffPad> pad = {};
  // Below this the frames are silent, or end.
  double heard_m = HUGE_VAL;
  bool trimmed = false;
  bool mirrored = false;
  std::size_t every = 1;  // of how many lines one is given
};

// Of a tissue, pressed once and estimated as often as asked.
class Window {
 public:
  explicit Window(const client::Tissue& t, double spacing_m = kSpacingM, double z_m = 0)
      : tissue_(t),
        left_m_((t.width_m - t.probe.width_m) / 2),
        probe_(client::press_solid(t, left_m_, kPushM, spacing_m, z_m)),
        rf_(client::with_noise(client::simulate_rf(t, probe_, client::RfFrame::kProbe, 5), 6)) {}

  Estimate estimate(const Asked& asked = {}, const std::vector<SliceBeside>& beside = {}) const {
    AcquisitionGeometry g;
    g.center_frequency_hz = tissue_.ultrasound.center_frequency_hz;
    g.sampling_frequency_hz = tissue_.ultrasound.sampling_frequency_hz;
    g.line_pitch_m = rf_.geometry.line_pitch_m * static_cast<double>(asked.every);
    const std::size_t all = rf_.geometry.sample_count, lines = rf_.geometry.line_count / asked.every,
                      heard = asked.heard_m < HUGE_VAL
                                  ? static_cast<std::size_t>(asked.heard_m / g.sample_pitch_m())
                                  : all,
                      given = asked.trimmed ? heard : all;
    const auto of = [&](const std::vector<std::int16_t>& samples) {
      RfFrame frame{given, lines, std::vector<float>(given * lines, 0.0F)};
      for (std::size_t line = 0; line < lines; ++line) {
        const std::size_t from = asked.every * (asked.mirrored ? lines - 1 - line : line);
        std::copy_n(samples.begin() + static_cast<std::ptrdiff_t>(from * all), heard,
                    frame.samples.begin() + static_cast<std::ptrdiff_t>(line * given));
      }
      return frame;
    };
    TissueExtent extent{tissue_.width_m, asked.stated_depth_m, left_m_, tissue_.poisson_ratio, asked.plane};
    extent.depth_stated = asked.depth, extent.probe_elevation_m = asked.elevation_m;
    extent.probe_elevation_std_m = asked.elevation_std_m, extent.pad = asked.pad;
    std::optional<ProbeForce> force;
    if (asked.force) force = ProbeForce{probe_.force_n, probe_.contact_area_m2};
    const ModulusBudget budget{.solves = asked.solves, .why_solves = "0.10 s are left"};
    static Elastography elastography(imaging_device());
    return elastography.estimate(of(rf_.pre), of(rf_.post),
                                 {g, force, extent, {}, {std::nullopt, {}, [&] { return budget; }}, beside});
  }

 private:
  client::Tissue tissue_;
  double left_m_;
  client::ProbeState probe_;
  client::RfPair rf_;
};

// Pressing takes a second: what several cases look at is pressed once, and estimated once as it comes.
const Window& even() {
  static const Window window(tissue());
  return window;
}
const Window& with_lump(bool sphere) {
  static const Window ball(tissue({}, 0.120, Lump{0.015, 3, true}), kFineSpacingM),
      cylinder(tissue({}, 0.120, Lump{0.015, 3, false}), kFineSpacingM);
  return sphere ? ball : cylinder;
}
const Estimate& lump_alone(bool sphere) {
  static const Estimate ball = with_lump(true).estimate(), cylinder = with_lump(false).estimate();
  return sphere ? ball : cylinder;
}

double median(std::vector<double> values) {
  if (values.empty()) return std::nan("");
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Median of the modulus where it is wanted, by x and y of the window.
double median_where(const std::vector<float>& map, const Estimate& e,
                    const std::function<bool(double, double)>& where) {
  std::vector<double> values;
  for (std::size_t n = 0; n < e.grid.size(); ++n)
    if (e.valid[n] && where(e.grid.x_m(n), e.grid.y_m(n))) values.push_back(map[n]);
  return median(values);
}

double median_where(const Estimate& e, const std::function<bool(double, double)>& where) {
  return median_where(e.modulus.youngs_modulus, e, where);
}

double deviation_where(const Estimate& e, const std::function<bool(double, double)>& where) {
  return median_where(e.modulus.log_deviation, e, where);
}

double background(const Estimate& e) {
  return median_where(
      e, [](double x, double y) { return y > 0.003 && y < 0.037 && std::abs(x - 0.03) > 0.009; });
}

bool within_lump(double x, double y) {
  return std::hypot(x - 0.03, y - 0.015) < 0.0035;
}
double contrast(const Estimate& e) {
  return median_where(e, within_lump) / background(e);
}

// From the upper third to the lower.
double ramp(const Estimate& e) {
  const auto third = [&](double above_m, double below_m) {
    return median_where(e, [=](double, double y) { return y > above_m && y < below_m; });
  };
  return third(0.026, 0.037) / third(0.003, 0.014);
}

// Part of the nodes from 3 mm down whose stated 95 % interval holds the truth.
double covered(const Estimate& e, const std::function<double(double, double)>& truth_pa) {
  double held = 0, all = 0;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    if (!e.valid[n] || e.grid.y_m(n) < 0.003) continue;
    const double off = std::log(e.modulus.youngs_modulus[n] / truth_pa(e.grid.x_m(n), e.grid.y_m(n)));
    ++all, held += std::abs(off) <= 1.96 * e.modulus.log_deviation[n];
  }
  return held / all;
}

// What the mean of ln E is off by from 3 mm down, over its deviation as it follows from what is stated.
double mean_off_in_deviations(const Estimate& e, double truth_pa) {
  constexpr std::size_t kStep = 37;  // of the nodes
  std::vector<std::size_t> nodes;
  for (std::size_t n = 0; n < e.grid.size(); n += kStep)
    if (e.valid[n] && e.grid.y_m(n) > 0.003) nodes.push_back(n);
  double sum = 0, variance = 0;
  for (const std::size_t a : nodes) {
    sum += std::log(e.modulus.youngs_modulus[a] / truth_pa);
    for (const std::size_t b : nodes)
      variance += e.modulus.log_deviation[a] * e.modulus.log_deviation[b] *
                  std::exp(-std::hypot(e.grid.x_m(a) - e.grid.x_m(b), e.grid.y_m(a) - e.grid.y_m(b)) /
                           e.modulus.correlation_m);
  }
  return sum / std::sqrt(variance);
}

bool warned(const Estimate& e, ModulusFlag flag) {
  return std::any_of(e.modulus.warnings.begin(), e.modulus.warnings.end(),
                     [&](const Warning& w) { return w.flag == flag; });
}

void print(const char* name, const Estimate& e) {
  std::printf("%-22s background %.2f kPa, ramp %.2f, %d steps; %s\n", name, 1e-3 * background(e), ramp(e),
              e.modulus.iterations, e.modulus.model.c_str());
}

TEST(SolidWindow, HomogeneousTissueIsRightWherePlaneStrainIsNot) {
  const Window& window = even();
  const Estimate solid = window.estimate(), plane = window.estimate({.plane = Plane::kStrain});
  print("solid", solid), print("plane strain", plane);
  EXPECT_EQ(solid.modulus.kind, ModulusKind::kSolid);
  EXPECT_TRUE(solid.modulus.converged);
  EXPECT_NEAR(background(solid) / kBackgroundPa, 1, 0.1);
  EXPECT_NEAR(std::log(ramp(solid)), 0, std::log(1.15));
  EXPECT_GE(covered(solid, [](double, double) { return kBackgroundPa; }), 0.9);
  EXPECT_FALSE(warned(solid, ModulusFlag::kMisfit));
  EXPECT_FALSE(warned(solid, ModulusFlag::kOutOfPlane));
  EXPECT_GT(background(plane) / kBackgroundPa, 1.4);  // the data are not of a plane
  EXPECT_TRUE(warned(plane, ModulusFlag::kOutOfPlane));
  // The topmost millimetres are known by what the face's ends show of them: hardly.
  std::size_t guessed = 0;
  for (std::size_t n = 0; n < solid.grid.size(); ++n) {
    if (!solid.valid[n] || solid.grid.y_m(n) > 0.002) continue;
    ASSERT_GE(solid.modulus.log_deviation[n], 0.2) << n;
    ++guessed;
  }
  EXPECT_GT(guessed, 100u);
}

TEST(SolidWindow, SpheresAndCylindersKeepTheirContrast) {
  for (const bool sphere : {true, false}) {
    const Estimate& e = lump_alone(sphere);
    const double inside = median_where(e, within_lump);
    std::printf("%s: contrast %.2f of 3\n", sphere ? "sphere" : "cylinder", contrast(e));
    EXPECT_NEAR(background(e) / kBackgroundPa, 1, 0.1);
    EXPECT_GE(inside / kBackgroundPa, 0.8 * 3);
    EXPECT_LE(inside / kBackgroundPa, 1.2 * 3);
    const double stated = deviation_where(e, within_lump);
    EXPECT_LE(std::abs(std::log(inside / kBackgroundPa / 3)), 1.96 * stated) << "one slice tells no shape";
    EXPECT_GE(covered(e,
                      [](double x, double y) {
                        return std::hypot(x - 0.03, y - 0.015) < 0.005 ? 3 * kBackgroundPa : kBackgroundPa;
                      }),
              0.85);
  }
}

// A slice shows a lump that lies beside it, and a lump's own slice shows the tissue beside that: what is
// known there is put down to it. `e` is as in the tissue's other slice, offset_m from this one.
SliceBeside beside(const Estimate& e, double offset_m) {
  return {offset_m, [&e](double x_m, double y_m) {
            const auto index = [](double at_m, double origin_m, double spacing_m, std::size_t nodes) {
              const double n = std::round((at_m - origin_m) / spacing_m);
              return static_cast<std::size_t>(std::clamp(n, 0.0, static_cast<double>(nodes - 1)));
            };
            const std::size_t node = index(x_m, e.grid.origin_x_m, e.grid.dx_m, e.grid.nx) +
                                     e.grid.nx * index(y_m, e.grid.origin_y_m, e.grid.dy_m, e.grid.ny);
            return e.valid[node] ? static_cast<double>(e.modulus.youngs_modulus[node]) : std::nan("");
          }};
}

// With its neighbours a sphere keeps its contrast; a cylinder loses a third, as they read it as a ball. A
// slice beside a sphere shows less of it.
TEST(SolidWindow, SlicesCorrectTheirNeighbours) {
  constexpr double kPitchM = 0.005;
  const Window &through = with_lump(true), &along = with_lump(false);
  const Window past(tissue({}, 0.120, Lump{0.015, 3, true}), kFineSpacingM, kPitchM);
  const auto between = [&](const Window& window, const Estimate& e) {
    return window.estimate({}, {beside(e, -kPitchM), beside(e, kPitchM)});
  };
  const Estimate &through_alone = lump_alone(true), &along_alone = lump_alone(false);
  const Estimate past_alone = past.estimate(), through_both = between(through, past_alone),
                 along_both = between(along, along_alone),
                 past_both = past.estimate({}, {beside(through_alone, -kPitchM)});
  std::printf(
      "sphere of 3: %.2f, with its neighbours %.2f; cylinder %.2f, %.2f; beside the sphere %.2f, %.2f\n",
      contrast(through_alone), contrast(through_both), contrast(along_alone), contrast(along_both),
      contrast(past_alone), contrast(past_both));
  EXPECT_NEAR(contrast(through_both) / 3, 1, 0.15);
  EXPECT_GE(contrast(along_both) / 3, 0.65);
  EXPECT_LE(contrast(past_both), contrast(past_alone)) << "of it only its rim reaches the slice";
  EXPECT_NEAR(background(through_both) / kBackgroundPa, 1, 0.1);
  const Estimate crowded = through.estimate({}, {beside(past_alone, -0.0005), beside(past_alone, 0.0005)});
  EXPECT_EQ(contrast(crowded), contrast(through_alone)) << "slices that the mesh does not tell apart";
  EXPECT_NE(past_both.modulus.model.find("; slices of it are known from -5.0 to -5.0 mm across the image"),
            std::string::npos)
      << past_both.modulus.model;
}

TEST(SolidWindow, TiltAndFrictionAreNoModulus) {
  client::Solid solid;
  solid.uneven = 0.1, solid.friction = HUGE_VAL;
  const Estimate e = Window(tissue(solid)).estimate();
  print("uneven, stuck", e);
  EXPECT_NEAR(background(e) / kBackgroundPa, 1, 0.12);
  const auto half = [&](double low_m, double high_m) {
    return median_where(e,
                        [=](double x, double y) { return x > low_m && x < high_m && y > 0.004 && y < 0.03; });
  };
  EXPECT_NEAR(half(0.04, 0.055) / half(0.005, 0.02), 1, 0.07);
}

// The number between these words of what an estimate assumed; none: not a number.
double after(const Estimate& e, const std::string& before, const std::string& behind) {
  const std::size_t at = e.modulus.model.find(before), end = e.modulus.model.find(behind);
  if (at == std::string::npos || end == std::string::npos || end < at) return NAN;
  return std::stod(e.modulus.model.substr(at + before.size(), end - at - before.size()));
}

// Neither the force, which tells the probe's elevation, nor the depth of the tissue.
TEST(SolidWindow, WhatIsNotStatedIsFitted) {
  const Window& window = even();
  const Estimate e = window.estimate({.force = false, .depth = false});
  EXPECT_FALSE(e.modulus.absolute);
  EXPECT_NEAR(std::log(ramp(e)), 0, std::log(1.15));
  EXPECT_NEAR(after(e, "solid tissue ", " mm deep (fitted)"), 40, 8) << e.modulus.model;
  EXPECT_NEAR(after(e, "under a face of 60.0 x ", " mm (fitted)"), 10, 2.5) << e.modulus.model;
  // Without the time to fit it is as usual, and that is said.
  const Estimate as_usual = window.estimate({.force = false, .depth = false, .solves = 0});
  EXPECT_TRUE(warned(as_usual, ModulusFlag::kCut));
  EXPECT_LT(as_usual.modulus_s, e.modulus_s / 2);
}

// A depth that is stated wrongly is seen, and fitted where there is time.
TEST(SolidWindow, AWrongDepthIsSeen) {
  client::Tissue deep = tissue();
  deep.ultrasound.depth_m = deep.depth_m, deep.depth_m = 0.060;
  const Estimate e = Window(deep).estimate({.stated_depth_m = 0.040});
  EXPECT_NEAR(after(e, "solid tissue ", " mm deep (stated as 40.0)"), 60, 6) << e.modulus.model;
}

// From a face that long on tissue that shallow no small step explains the strain better.
TEST(SolidWindow, AFaceStatedMuchTooLongIsSeen) {
  client::Solid solid;
  solid.friction = 0.15, solid.preload_m = 0.00075;
  client::Tissue shallow = tissue(solid, 0.060, Lump{0.010, 5, true});
  shallow.depth_m = 0.020, shallow.probe.width_m = 0.030, shallow.seed = 7;
  shallow.inclusions[0].diameter_m = 0.006;
  const Window window(shallow);
  const auto stated = [&](double elevation_m) {
    return window.estimate({.stated_depth_m = 0.020, .elevation_m = elevation_m});
  };
  const Estimate right = stated(kElevationM), wrong = stated(1.75 * kElevationM);
  std::printf("background %.0f, %.0f: %s\n", background(right), background(wrong),
              wrong.modulus.model.c_str());
  EXPECT_FALSE(warned(right, ModulusFlag::kElevation)) << right.modulus.model;
  EXPECT_TRUE(warned(wrong, ModulusFlag::kElevation)) << wrong.modulus.model;
  EXPECT_NE(wrong.modulus.model.find("under a face of 17.5 mm"), std::string::npos)
      << "the other is named so";
}

// With a lump the fit alone does not see it, and the lump's contrast is a quarter too high.
TEST(SolidWindow, ADepthStatedAmidStrainIsNotBelieved) {
  const Estimate &as_it_is = lump_alone(true),
                 e = with_lump(true).estimate({.stated_depth_m = 0.027, .elevation_m = 0.010});
  std::printf("contrast %.2f, %.2f: %s\n", contrast(as_it_is), contrast(e), e.modulus.model.c_str());
  EXPECT_TRUE(warned(e, ModulusFlag::kElevation)) << e.modulus.model;
  EXPECT_NEAR(contrast(e) / contrast(as_it_is), 1, 0.1);
  EXPECT_NEAR(background(e) / background(as_it_is), 1, 0.1);
}

TEST(SolidWindow, TissueAsWideAsTheProbeIsToldFromTissueThatGoesOn) {
  client::Solid solid;
  solid.elevational_width_m = kElevationM;
  const Estimate e = Window(tissue(solid, kProbeM)).estimate();
  print("as wide as the probe", e);
  EXPECT_NE(e.modulus.model.find("as wide as the probe"), std::string::npos) << e.modulus.model;
  EXPECT_NEAR(background(e) / kBackgroundPa, 1, 0.1);
  EXPECT_LT(std::abs(mean_off_in_deviations(e, kBackgroundPa)), 1.96);
}

TEST(SolidWindow, TissueThatSlidesOnItsSupportIsTold) {
  client::Solid solid;
  solid.support = client::Support::kSliding;
  const Estimate e = Window(tissue(solid)).estimate();
  print("sliding", e);
  EXPECT_NE(e.modulus.model.find("slides on its support"), std::string::npos) << e.modulus.model;
  EXPECT_NEAR(background(e) / kBackgroundPa, 1, 0.05);
  EXPECT_NEAR(std::log(ramp(e)), 0, std::log(1.15));
  EXPECT_FALSE(warned(e, ModulusFlag::kMisfit));
  const double off = mean_off_in_deviations(e, kBackgroundPa);
  std::printf("the mean of ln E is off by %.2f of its deviations; it correlates over %.1f mm\n", off,
              1e3 * e.modulus.correlation_m);
  EXPECT_LE(std::abs(off), 1.96) << "part of what it is off by is alike all around";
  std::vector<double> squares;
  for (std::size_t n = 0; n < e.grid.size(); ++n)
    if (e.valid[n] && e.grid.y_m(n) > 0.003) squares.push_back(std::pow(e.modulus.log_deviation[n], 2));
  const double all = median(squares), common = std::pow(0.06, 2),  // of tissue that ends (T3.6)
      own = std::exp(-1) * (all - common);                         // 5 mm apart, its correlation length
  EXPECT_GE(std::exp(-0.005 / e.modulus.correlation_m), 0.9 * (own + common) / all);
}

// Where an end of the face does not touch, background and lump are off by factors, all alike: no silent wrong
// number. A face that is pushed in unevenly is another matter.
TEST(SolidWindow, AFaceThatTouchesInPartIsSaid) {
  client::Solid solid;
  solid.lean_m = 0.0025;
  const Estimate part = Window(tissue(solid, 0.120, Lump{0.015, 3, true}), kFineSpacingM).estimate();
  print("in part", part);
  EXPECT_TRUE(warned(part, ModulusFlag::kMisfit));
  EXPECT_TRUE(warned(part, ModulusFlag::kExtent)) << "what misfit states hides no other warning";
  const auto lump = [](double x, double y) { return std::hypot(x - 0.03, y - 0.015) < 0.0035; };
  const double off = std::log(median_where(part, lump) / kBackgroundPa / 3);
  std::printf("its lump is off by a factor of %.3f, stated %.2f\n", std::exp(off),
              deviation_where(part, lump));
  EXPECT_LE(std::abs(off), 1.96 * deviation_where(part, lump));
  EXPECT_GE(part.modulus.correlation_m, 0.010) << "what it is off by is alike all over the lump";
  float least = HUGE_VALF;
  for (std::size_t n = 0; n < part.grid.size(); ++n)
    if (part.valid[n]) least = std::min(least, part.modulus.log_deviation[n]);
  EXPECT_GE(least, 2.3F) << "a factor of ten, wherever it is";
  solid.lean_m = 0, solid.uneven = 0.1;
  const Estimate uneven = Window(tissue(solid, 0.120, Lump{0.015, 4, true}), kFineSpacingM).estimate();
  print("uneven", uneven);
  EXPECT_FALSE(warned(uneven, ModulusFlag::kMisfit));
  EXPECT_FALSE(warned(uneven, ModulusFlag::kExtent));
}

TEST(SolidWindow, ATimeLimitIsKeptAndSaid) {
  const Estimate e = Window(tissue({}, 0.120, Lump{0.015, 5, true})).estimate({.solves = 0});
  EXPECT_EQ(e.modulus.iterations, 1);
  EXPECT_FALSE(e.modulus.converged);
  EXPECT_TRUE(warned(e, ModulusFlag::kCut));
  const auto lump = [](double x, double y) { return std::hypot(x - 0.03, y - 0.015) < 0.0035; };
  const double inside = median_where(e, lump);
  std::printf("one step: contrast %.2f of 5, stated %.2f\n", inside / kBackgroundPa,
              deviation_where(e, lump));
  EXPECT_LE(std::abs(std::log(inside / kBackgroundPa / 5)), 1.96 * deviation_where(e, lump));
}

// What explains the strain may not be all that would: other tissue that was not tried is said, and counts.
TEST(SolidWindow, WhatWasNotTriedIsSaidAndCounts) {
  constexpr int kUsual = 20;  // solves
  const auto stated = [](int solves) {
    return even().estimate({.solves = solves, .elevation_m = kElevationM});
  };
  const auto all = [](double, double) { return true; };
  const Estimate whole = stated(ModulusBudget::kAll), cut = stated(kUsual);
  EXPECT_FALSE(warned(whole, ModulusFlag::kCut));
  EXPECT_TRUE(warned(cut, ModulusFlag::kCut));
  EXPECT_TRUE(cut.modulus.converged);
  EXPECT_GE(deviation_where(cut, all), 0.1);
  const Estimate one_step = even().estimate({.depth = false, .solves = 0});
  EXPECT_FALSE(one_step.modulus.converged);
  EXPECT_EQ(std::ranges::count(one_step.modulus.warnings, ModulusFlag::kCut, &Warning::flag), 1)
      << "all that there was no time for is one warning";
}

TEST(SolidWindow, TurnedAndThinnedFramesGiveTheSame) {
  const Estimate& whole = lump_alone(true);
  for (const Asked& asked : {Asked{}, Asked{.mirrored = true}, Asked{.every = 2}}) {
    const Estimate other = with_lump(true).estimate(asked);
    std::printf("background %.0f Pa, contrast %.2f\n", background(other), contrast(other));
    EXPECT_LE(std::abs(std::log(background(other) / background(whole))), 0.05);
    EXPECT_LE(std::abs(std::log(contrast(other) / contrast(whole))), 0.1);
    if (asked.mirrored || asked.every > 1) continue;
    for (std::size_t n = 0; n < whole.grid.size(); ++n) {
      ASSERT_EQ(whole.valid[n], other.valid[n]) << n;
      if (!whole.valid[n]) continue;
      ASSERT_NEAR(std::log(whole.modulus.youngs_modulus[n] / other.modulus.youngs_modulus[n]), 0, 1e-3) << n;
    }
  }
}

// A beamformer's window that ends before its file does, short of the tissue's bottom.
TEST(SolidWindow, SilenceBelowChangesNothing) {
  for (const double heard_m : {0.024, 0.030}) {
    Asked asked{.heard_m = heard_m};
    const Estimate whole = with_lump(true).estimate(asked);
    asked.trimmed = true;
    const Estimate trimmed = with_lump(true).estimate(asked);
    std::printf("%.0f mm heard: background %.0f and %.0f Pa, contrast %.2f and %.2f\n", 1e3 * heard_m,
                background(whole), background(trimmed), contrast(whole), contrast(trimmed));
    EXPECT_LE(std::abs(std::log(background(whole) / background(trimmed))), 0.05);
    EXPECT_LE(std::abs(std::log(contrast(whole) / contrast(trimmed))), 0.1);
    EXPECT_NEAR(contrast(trimmed), 3, 0.3);
    for (std::size_t n = 0; n < whole.grid.size(); ++n) {
      ASSERT_TRUE(!whole.valid[n] || std::isfinite(whole.axial_strain[n])) << n;
      ASSERT_TRUE(!whole.valid[n] || whole.grid.y_m(n) < heard_m) << n;
    }
  }
}

// A narrow probe, and sizes at the ends of what a request may state: answered or refused, in bounded memory.
TEST(SolidWindow, ExtremeSizesAreAnsweredOrRefused) {
  const Window& window = even();
  for (const double depth_m : {0.004, 0.3, 1.0})
    for (const double elevation_m : {1e-4, 2e-3, 0.2}) {
      try {
        const Estimate e =
            window.estimate({.solves = 0, .stated_depth_m = depth_m, .elevation_m = elevation_m});
        for (std::size_t n = 0; n < e.grid.size(); ++n) {
          if (!e.valid[n]) continue;
          ASSERT_TRUE(std::isfinite(e.modulus.youngs_modulus[n]) && e.modulus.log_deviation[n] > 0) << n;
        }
      } catch (const std::invalid_argument& refused) {
        EXPECT_STRNE(refused.what(), "");
      } catch (const TrackingError& refused) {
        EXPECT_STRNE(refused.what(), "");
      }
    }
}

// Without a force: a layer that the truth has as a capsule, stated as it is, tells the modulus of what is
// below.
TEST(SolidWindow, APadTakesTheForcesPlace) {
  constexpr double kPadM = 0.008, kRatio = 0.5;
  client::Solid solid;
  solid.capsule_m = kPadM, solid.capsule_contrast = kRatio;
  const Window window(tissue(solid));
  Asked asked;
  asked.force = false, asked.elevation_m = kElevationM, asked.elevation_std_m = 0.03 * kElevationM;
  asked.pad = StandoffPad{1.1 * kPadM, kRatio * kBackgroundPa, 0.1 * kPadM, 0.05 * kRatio * kBackgroundPa};
  const Estimate e = window.estimate(asked);
  const auto below = [](double, double y) { return y > kPadM + 0.002 && y < 0.037; };
  const double found = median_where(e, below), deviation = deviation_where(e, below);
  std::printf("under a pad: %.0f Pa of %.0f, deviation %.3f; %s\n", found, kBackgroundPa, deviation,
              e.modulus.model.c_str());
  EXPECT_TRUE(e.modulus.absolute);
  EXPECT_NEAR(found, kBackgroundPa, 0.08 * kBackgroundPa);
  EXPECT_LE(std::abs(std::log(found / kBackgroundPa)), 1.96 * deviation);
  EXPECT_LT(deviation, 0.2);
  for (std::size_t n = 0; n < e.grid.size(); ++n)
    EXPECT_FALSE(e.valid[n] && e.grid.y_m(n) < kPadM - 0.0005) << "the pad is no tissue";
}

}  // namespace
}  // namespace teletact::service
