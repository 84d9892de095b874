// What holds no echo, leaves the frame or is coupling is not valid, and spoils nothing beside it.
#include "service/imaging/tracking/echoes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "service/imaging/tracking/displacement.h"
#include "service/imaging/tracking/measured.h"
#include "tests/imaging/imaging_device.h"
#include "tests/imaging/speckle.h"

namespace teletact::service {
namespace {

constexpr std::size_t kSamples = 640, kLines = 64, kHeard = 576;
constexpr double kStrain = -0.015;

const Speckle& tissue() {
  static const Speckle speckle({.samples = kSamples, .lines = kLines, .snr_db = 30, .correlation = 0.99});
  return speckle;
}

struct Pair {
  RfFrame pre, post;
};

const Pair& pressed() {
  static const Pair pair{tissue().frame(
                             [](double, double) {
                               return std::pair{0.0, 0.0};
                             },
                             1),
                         tissue().frame(
                             [](double, double y) {
                               return std::pair{0.0, kStrain * y};
                             },
                             2)};
  return pair;
}

// `change(sample, line, k, frame)` of both frames.
template <class Change>
Pair changed(const Pair& pair, Change change) {
  Pair out = pair;
  for (RfFrame* frame : {&out.pre, &out.post})
    for (std::size_t n = 0; n < frame->samples.size(); ++n)
      change(frame->samples[n], n / frame->sample_count, n % frame->sample_count, frame == &out.post);
  return out;
}

Measured measure(const Pair& pair, int first = 0) {
  const Queue queue = imaging_device()->queue();
  DisplacementEstimator tracker(queue, {});
  StrainEstimator strain(queue, {});
  const AcquisitionGeometry geometry = tissue().geometry();
  const DisplacementEstimate found =
      tracker.estimate(pair.pre, pair.post, geometry, find_echoes(pair.pre, geometry), first);
  Measured m;
  m.grid = image_grid(found.grid, tissue().geometry());
  download(queue, found, m);
  download(queue, strain.estimate(found, m.grid), m);
  return m;
}

double depth_m(std::size_t samples) {
  return static_cast<double>(samples) * tissue().geometry().sample_pitch_m();
}

double valid_part(const Measured& m, double from_m, double to_m) {
  double all = 0, valid = 0;
  for (std::size_t n = 0; n < m.grid.size(); ++n)
    if (m.grid.y_m(n) >= from_m && m.grid.y_m(n) < to_m) ++all, valid += m.strain_valid[n];
  return valid / all;
}

// Largest difference of the strain at nodes that are valid in both, of its magnitude.
double off(const Measured& a, const Measured& b) {
  double most = 0;
  for (std::size_t n = 0; n < std::min(a.grid.size(), b.grid.size()); ++n)
    if (a.strain_valid[n] && b.strain_valid[n])
      most = std::max(most, std::abs(a.axial_strain[n] - b.axial_strain[n]) / std::abs(kStrain));
  return most;
}

enum class Tail { kZeros, kConstant, kHum, kNoise, kPattern };
class SilentTail : public ::testing::TestWithParam<Tail> {};

TEST_P(SilentTail, IsNotValidAndTheRestIsAsIfItWereCutOff) {
  std::mt19937 random(5), pattern(6);
  std::normal_distribution<float> normal(0, 2);
  std::vector<float> same(kSamples * kLines);
  for (float& v : same) v = normal(pattern);
  const Measured whole = measure(changed(pressed(), [&](float& sample, std::size_t l, std::size_t k, bool) {
    if (k < kHeard) return;
    switch (GetParam()) {
      case Tail::kZeros:
        sample = 0;
        break;
      case Tail::kConstant:
        sample = 3;
        break;
      case Tail::kHum:
        sample = 3 * std::sin(static_cast<float>(k));
        break;
      case Tail::kNoise:
        sample = normal(random);
        break;
      case Tail::kPattern:
        sample = same[k + kSamples * l];
        break;
    }
  }));
  Pair cut;
  for (const auto& [from, to] : {std::pair{&pressed().pre, &cut.pre}, {&pressed().post, &cut.post}}) {
    to->sample_count = kHeard, to->line_count = kLines;
    for (std::size_t l = 0; l < kLines; ++l) {
      const auto line = from->samples.begin() + static_cast<std::ptrdiff_t>(l * kSamples);
      to->samples.insert(to->samples.end(), line, line + kHeard);
    }
  }
  const Measured trimmed = measure(cut);
  EXPECT_EQ(valid_part(whole, depth_m(kHeard) - 1e-3, 1), 0);
  EXPECT_GE(valid_part(whole, 0, depth_m(kHeard) - 2.5e-3), 0.95);
  ASSERT_EQ(whole.grid.nx, trimmed.grid.nx);
  EXPECT_NEAR(whole.grid.origin_y_m, trimmed.grid.origin_y_m, whole.grid.dy_m);
  double most = 0;  // the grids' rows may lie between each other
  for (std::size_t n = 0; n < whole.grid.size(); ++n) {
    const double row = (whole.grid.y_m(n) - trimmed.grid.origin_y_m) / trimmed.grid.dy_m;
    const auto above = static_cast<std::size_t>(std::max(row, 0.0)) * trimmed.grid.nx + n % whole.grid.nx;
    const std::size_t below = std::min(above + trimmed.grid.nx, trimmed.grid.size() - 1);
    if (!whole.strain_valid[n] || above >= trimmed.grid.size() || !trimmed.strain_valid[above]) continue;
    const double share = row - std::floor(row);
    const double there = (1 - share) * trimmed.axial_strain[above] + share * trimmed.axial_strain[below];
    most = std::max(most, std::abs(whole.axial_strain[n] - there) / std::abs(kStrain));
  }
  EXPECT_LE(most, 0.05);
}
INSTANTIATE_TEST_SUITE_P(Kinds, SilentTail,
                         ::testing::Values(Tail::kZeros, Tail::kConstant, Tail::kHum, Tail::kNoise,
                                           Tail::kPattern));

// As loud as half of the echoes, and of their spectrum: that it stays where it is tells it.
TEST(Echoes, WhatStaysBelowMovingTissueIsNotValid) {
  constexpr std::size_t kMoving = 448;
  const Pair pair = changed(pressed(), [](float& sample, std::size_t l, std::size_t k, bool) {
    if (k >= kMoving) sample = 0.5f * pressed().pre.samples[k + kSamples * l];
  });
  const Echoes echoes = find_echoes(pair.pre, tissue().geometry());
  EXPECT_EQ(echoes.lines[kLines / 2].end, static_cast<int>(kSamples)) << "it is not silent";
  const int from = still_from(pair.pre, pair.post, echoes.step);
  EXPECT_LE(from, static_cast<int>(kMoving));
  EXPECT_GE(from, static_cast<int>(kMoving) - 2 * echoes.step);
  const Measured m = measure(pair);
  EXPECT_EQ(valid_part(m, depth_m(kMoving) - 1e-3, 1), 0);
  EXPECT_GE(valid_part(m, 0, depth_m(kMoving) - 2.5e-3), 0.95);
}

// Tissue on a far side that rests moves less and less towards it.
TEST(Echoes, TissueThatComesToRestIsHeard) {
  const auto moved = [](double rest_m) {
    return tissue().frame(
        [=](double, double y) {
          return std::pair{0.0, -kStrain * std::max(rest_m - y, 0.0)};
        },
        2);
  };
  const int step = find_echoes(pressed().pre, tissue().geometry()).step;
  EXPECT_EQ(still_from(pressed().pre, moved(depth_m(kSamples)), step), static_cast<int>(kSamples));
  EXPECT_EQ(still_from(pressed().pre, pressed().pre, step), static_cast<int>(kSamples));
}

TEST(Echoes, OrdinarySpeckleIsHeardEverywhere) {
  for (const EchoSpan& span : find_echoes(pressed().pre, tissue().geometry()).lines)
    EXPECT_EQ(span, (EchoSpan{0, static_cast<int>(kSamples)}));
}

TEST(Echoes, SilentLinesAreNotValidNorSpoilOthers) {
  const auto silent = [](std::size_t l) { return l < 12 || l == 40; };
  const Measured m = measure(changed(pressed(), [&](float& sample, std::size_t l, std::size_t, bool) {
    if (silent(l)) sample = 0;
  }));
  const Measured heard = measure(pressed());
  std::size_t valid = 0;
  for (std::size_t n = 0; n < m.grid.size(); ++n) {
    if (!m.displacement_valid[n]) continue;
    ++valid;
    const double line = m.grid.x_m(n) / tissue().geometry().line_pitch_m - 0.5;
    EXPECT_TRUE(line > 15 && std::abs(line - 40) > 3) << line;
  }
  EXPECT_GE(static_cast<double>(valid) / static_cast<double>(m.grid.size()), 0.5);
  EXPECT_LE(off(m, heard), 0.1);
}

TEST(Echoes, TissueThatLeavesTheFrameIsNotValid) {
  const Pair swapped{pressed().post, pressed().pre};
  const Measured m = measure(swapped);
  const double width_m = static_cast<double>(kLines) * tissue().geometry().line_pitch_m;
  std::size_t left = 0;
  for (std::size_t n = 0; n < m.grid.size(); ++n) {
    const double x = m.grid.x_m(n) + m.lateral_displacement[n], y = m.grid.y_m(n) + m.axial_displacement[n];
    if (x >= 0 && x < width_m && y >= 0 && y < depth_m(kSamples)) continue;
    ++left;
    EXPECT_FALSE(m.displacement_valid[n] || m.strain_valid[n]) << n;
  }
  EXPECT_GT(left, 0u);
  for (std::size_t n = 0; n < m.grid.size(); ++n) {
    if (m.strain_valid[n]) {
      EXPECT_NEAR(m.axial_strain[n], -kStrain, 0.2 * -kStrain) << n;
    }
  }
}

// Echoes that stand still, or none, above a bright line; tissue that begins at it.
constexpr std::size_t kSurface = 200;
Pair coupled(const Pair& pair, float bright, float heard) {
  return changed(pair, [=](float& sample, std::size_t, std::size_t k, bool) {
    const double from = std::abs(static_cast<double>(k) - kSurface + 12);
    sample *= from <= 12 ? bright : k < kSurface ? heard : 1;
  });
}

TEST(Echoes, CouplingAboveABrightLineIsLeftOut) {
  const double surface_m = depth_m(kSurface);
  const Motion motion = [=](double, double y) {
    return std::pair{0.0, kStrain * std::max(y - surface_m, 0.0)};
  };
  const Pair plain{tissue().frame(
                       [](double, double) {
                         return std::pair{0.0, 0.0};
                       },
                       1),
                   tissue().frame(motion, 2)};
  for (const float heard : {0.1f, 0.0f}) {
    const Pair pair = coupled(plain, 20, heard);
    const int end = coupling_end(pair.pre, pair.post, find_echoes(pair.pre, tissue().geometry()));
    EXPECT_NEAR(end, kSurface, 25) << heard;
    Measured m = measure(pair, end);
    EXPECT_TRUE(rests_below(depth_m(kSurface), m));
    m.coupling_m = surface_m;
    leave_out_above(surface_m + 2.5e-3, m);
    EXPECT_EQ(valid_part(m, 0, surface_m + 2.5e-3), 0);
    EXPECT_GE(valid_part(m, surface_m + 2.5e-3, 1), 0.95);
    EXPECT_GE(m.quality, 0.6);
    for (std::size_t n = 0; n < m.grid.size(); ++n) {
      if (m.strain_valid[n]) {
        EXPECT_NEAR(m.axial_strain[n], kStrain, 0.1 * -kStrain) << n;
      }
    }
    const Pair dull = coupled(plain, 1, heard);
    EXPECT_EQ(coupling_end(dull.pre, dull.post, find_echoes(dull.pre, tissue().geometry())), 0)
        << "nothing bright";
  }
}

TEST(Echoes, ABrightLineAmidTissueIsNoCoupling) {
  for (const double strain : {kStrain, kStrain / 6}) {
    const Pair plain{pressed().pre, tissue().frame(
                                        [=](double, double y) {
                                          return std::pair{0.0, strain * y};
                                        },
                                        2)};
    const Pair pair = coupled(plain, 20, 1);
    const int end = coupling_end(pair.pre, pair.post, find_echoes(pair.pre, tissue().geometry()));
    EXPECT_FALSE(end > 0 && rests_below(depth_m(kSurface), measure(pair, end))) << strain;
  }
}

}  // namespace
}  // namespace teletact::service
