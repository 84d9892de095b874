// Solid tissue under a probe (T3.6) that ends beside it, slides, or goes on: what the forward model does with
// each, and what the estimate takes it for. A probe of 30 x 5 mm on 20 mm, which is solved fast.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/cell_strains.h"
#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/probe_fit.h"
#include "service/imaging/modulus/probed_tissue.h"
#include "tests/imaging/modulus/pressed.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using test::background, test::face, test::kDepthM, test::kElevationM, test::kModulusPa, test::kNowhere,
    test::kWidthM, test::Pressed, test::solid, test::warned;

double mean_of_row(const Eigen::VectorXd& field, const CellGrid& cells, std::size_t row) {
  const auto columns = static_cast<Index>(cells.columns);
  return field.segment(static_cast<Index>(row) * columns, columns).mean();
}

// Its sides bear nothing: all of the force goes down the column, and it widens freely.
TEST(ProbedSolid, AColumnAsWideAsTheProbeBearsTheForceEvenly) {
  const auto column = solid(face(0));
  const auto response = column->push_homogeneous();
  const CellGrid& cells = column->cells();
  const double even_n = kWidthM * kElevationM / kDepthM;  // E A / depth, of 1 Pa
  std::printf("a column: force %.3f of E A / depth\n", response.force_n / even_n);
  // Bonded at its end it is held there, and what lies beside it has 1 % of its modulus.
  EXPECT_GE(response.force_n, even_n);
  EXPECT_LE(response.force_n, 1.2 * even_n);
  for (const std::size_t row : {4u, 8u, 12u}) {
    const double axial = -mean_of_row(response.axial_strain, cells, row),
                 lateral = mean_of_row(response.lateral_strain, cells, row);
    EXPECT_NEAR(axial * kDepthM, 1, 0.15) << row;
    EXPECT_NEAR(lateral / axial, 0.45, 0.07) << row;
  }
  EXPECT_EQ(column->force_share(), 1);
}

TEST(ProbedSolid, TissueThatEndsFarAwayIsTissueThatGoesOn) {
  const auto far = solid(face(1)), on = solid(face()), near = solid(face(0.005));
  const auto of_far = far->push_homogeneous(), of_on = on->push_homogeneous(),
             of_near = near->push_homogeneous();
  ASSERT_EQ(far->cells().size(), on->cells().size());
  const auto off = [&](const ProbedTissue::Response& of) {
    double most = 0;
    for (std::size_t row = 4; row < on->cells().rows; ++row)
      most = std::max(most, std::abs(std::log(mean_of_row(of.axial_strain, on->cells(), row) /
                                              mean_of_row(of_on.axial_strain, on->cells(), row))));
    return most;
  };
  std::printf("ends far away: strain off by %.3f, ends 5 mm beside: %.3f\n", off(of_far), off(of_near));
  EXPECT_LE(off(of_far), 0.1);
  EXPECT_GE(off(of_near), 2 * off(of_far));
  EXPECT_LT(of_near.force_n, of_on.force_n);
}

// Of a face of 60 x 10 mm on 40 mm: ln of the strain, beside each other, and of the force are those of 31
// nodes across the face in place of 7.
TEST(ProbedSolid, FewNodesUnderTheFaceAreEnough) {
  struct At {
    std::size_t row;
    double log_strain;
  };
  constexpr std::array kFiner{At{4, 3.7001},  At{6, 3.8195},  At{8, 3.7974},  At{10, 3.7260},
                              At{15, 3.5003}, At{20, 3.2731}, At{25, 3.0404}, At{30, 2.7528}};
  constexpr double kLogForce = -2.6493;
  const auto tissue = solid({0.060, 0.010, 0.040, 0.040, 0.49});
  const auto response = tissue->push_homogeneous();
  const CellGrid& cells = tissue->cells();
  const auto middle = static_cast<Index>(cells.columns / 2), quarter = middle / 2;
  std::vector<double> off;
  for (const At& at : kFiner) {
    const auto first = static_cast<Index>(at.row * cells.columns) + quarter;
    off.push_back((-response.axial_strain.segment(first, middle)).array().log().mean() - at.log_strain);
  }
  const double level = std::accumulate(off.begin(), off.end(), 0.0) / static_cast<double>(off.size());
  for (const double of : off) EXPECT_NEAR(of, level, 0.01);
  EXPECT_NEAR(level, 0, 0.01);
  EXPECT_NEAR(std::log(response.force_n / tissue->force_share()), kLogForce, 0.01);
}

// Whether the last one was on the same mesh or not, and whatever was solved in it, or cancelled there.
TEST(ProbedSolid, TheLastOnesSolverChangesNothing) {
  ProbeFace longer = face(0.005), tougher = face(0.005);
  longer.elevation_m *= 1.1, tougher.poisson_ratio = 0.45;
  constexpr int kMostLooks = 5;
  int cancelled_pushes = 0;
  for (const ProbeFace& f : {face(0.005), face(0.005, true), longer, tougher})
    for (const int most_looks : {0, kMostLooks}) {
      const auto last = solid(face());
      last->push_homogeneous(0.1);
      for (int looks = 1; looks < most_looks; ++looks) try {
          const CancellationCheck cancelled([left = looks]() mutable {
            if (--left == 0) throw std::runtime_error("cancelled");
          });
          last->push_homogeneous(0.2);
        } catch (const std::runtime_error&) {
          ++cancelled_pushes;
        }
      const auto of_own = solid(f)->push_homogeneous(),
                 after =
                     make_probed_solid(imaging_device()->queue(), f, kFineCellM, last)->push_homogeneous();
      EXPECT_EQ(after.axial_strain, of_own.axial_strain);
      EXPECT_EQ(after.force_n, of_own.force_n);
    }
  EXPECT_GT(cancelled_pushes, 0);
}

// Bonded tissue does not widen at its bottom; tissue that slides does, bears less, and is not lifted off.
TEST(ProbedSolid, TissueThatSlidesWidensAtItsBottom) {
  const auto bonded = solid(face(0.014)), sliding = solid(face(0.014, true));
  const auto held = bonded->push_homogeneous(), free = sliding->push_homogeneous();
  const CellGrid& cells = bonded->cells();
  ASSERT_EQ(cells.size(), sliding->cells().size());
  const std::size_t last = cells.rows - 1;
  const auto ratio = [&](const ProbedTissue::Response& r) {
    return -mean_of_row(r.lateral_strain, cells, last) / mean_of_row(r.axial_strain, cells, last);
  };
  std::printf("lateral over axial strain at the bottom: bonded %.3f, sliding %.3f\n", ratio(held),
              ratio(free));
  EXPECT_LE(ratio(held), 0.22);
  EXPECT_GE(ratio(free), 0.3);
  EXPECT_LT(free.force_n, held.force_n);
  double carried = 0;
  for (std::size_t row = 0; row < cells.rows; ++row)
    carried -= mean_of_row(free.axial_strain, cells, row) * cells.row_m;
  EXPECT_NEAR(carried, 1, 0.01) << "rollers take none of the push";
}

// A column whose cells differ by thousands of times needs more iterations than a solve may take. The next one
// is not the worse for it.
TEST(ProbedSolid, ASolutionThatStopsShortIsNoAnswer) {
  const auto column = solid(face(0));
  Eigen::VectorXd log_modulus(static_cast<Index>(column->cells().size()));
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0, 3);
  for (double& l : log_modulus) l = normal(random);
  try {
    column->push(log_modulus, 0, {});
    FAIL() << "it answered";
  } catch (const std::invalid_argument& error) {
    const std::string said = error.what();
    EXPECT_NE(said.find("iteration limit"), std::string::npos) << said;
    EXPECT_NE(said.find("poisson_ratio"), std::string::npos) << said;
  }
  EXPECT_GT(column->push_homogeneous().force_n, 0);
}

bool says(const ModulusEstimate& e, const char* words) {
  return e.model.find(words) != std::string::npos;
}

// The steps of a modulus go back to a map that was solved.
TEST(ProbedSolid, APushThatFailedLeavesTheNextOneAlone) {
  const auto tissue = solid(face());
  const auto size = static_cast<Index>(tissue->cells().size());
  const Eigen::VectorXd good = Eigen::VectorXd::Zero(size);
  Eigen::VectorXd wild = good;
  for (Index c = 0; c < size; ++c) wild[c] = c % 2 ? 14 : -14;
  const double force_n = tissue->push(good).force_n;
  EXPECT_THROW(tissue->push_again(wild, 0, {}), std::invalid_argument);
  EXPECT_NEAR(tissue->push_again(good, 0, {}).force_n, force_n, 5e-3 * force_n);
}

TEST(ProbeFit, TellsWhereTissueEndsAndWhetherItSlides) {
  struct Case {
    ProbeFace of;
    const char* is;
    double ends_mm = 0;
  };
  for (const Case& c :
       {Case{face(), "that continues beside the probe, under"}, Case{face(0.007), "mm beside the probe", 7},
        Case{face(0.015, true), "mm beside the probe and slides on its support", 15},
        Case{face(0), "that is as wide as the probe"}}) {
    const Pressed pressed(c.of);
    const ModulusEstimate e = pressed.estimate();
    std::printf("background %.2f kPa: %s\n", 1e-3 * background(e, pressed.measured), e.model.c_str());
    EXPECT_TRUE(says(e, c.is)) << e.model;
    double ends_mm = 0;
    const std::size_t ends = std::min(e.model.find("that ends some "), e.model.size());
    if (std::sscanf(e.model.c_str() + ends, "that ends some %lf mm", &ends_mm) == 1 || c.ends_mm > 0) {
      EXPECT_NEAR(ends_mm, c.ends_mm, 3) << e.model;
    }
    double elevation_mm = 0;
    const std::size_t at = std::min(e.model.find("30.0 x "), e.model.size());
    EXPECT_EQ(std::sscanf(e.model.c_str() + at, "30.0 x %lf mm", &elevation_mm), 1) << e.model;
    EXPECT_NEAR(elevation_mm, 1e3 * kElevationM, 0.6) << e.model;
    EXPECT_NEAR(background(e, pressed.measured) / kModulusPa, 1, 0.1) << e.model;
    EXPECT_FALSE(warned(e, ModulusFlag::kMisfit)) << e.model;
  }
}

// A stated width is believed unless the strain contradicts it. What ends beyond the mesh goes on.
TEST(ProbeFit, BelievesAStatedWidth) {
  for (const auto& [of, beside_m, is] : {std::tuple(face(), 0.1, "that continues beside the probe, under"),
                                         std::tuple(face(0.007), 0.007, "that ends some 7 mm"),
                                         std::tuple(face(0), 1e-9, "that is as wide as the probe, under")}) {
    const Pressed pressed(of);
    const ModulusEstimate e = pressed.estimate({}, beside_m);
    EXPECT_TRUE(says(e, is)) << e.model;
    EXPECT_NEAR(background(e, pressed.measured) / kModulusPa, 1, 0.1) << e.model;
  }
}

// Stated as wide, but not well, tissue may end anywhere.
TEST(ProbeFit, AWidthIsBelievedAsFarAsItIsStated) {
  const Pressed pressed(face(0.010));
  const ModulusEstimate e = pressed.estimate({}, 0.03, kDepthM, {}, kElevationM, 0.015);
  EXPECT_TRUE(says(e, "that ends some")) << e.model;
  EXPECT_NEAR(background(e, pressed.measured) / kModulusPa, 1, 0.1) << e.model;
}

// Tissue that goes on may hold a depth that is stated half too large; tissue that ends does not.
TEST(ProbeFit, AWrongDepthOfTissueThatEndsIsFoundAndSaid) {
  const Pressed pressed(face(0.010));
  const ModulusEstimate e = pressed.estimate({}, {}, 1.5 * kDepthM);
  std::printf("background %.2f kPa: %s\n", 1e-3 * background(e, pressed.measured), e.model.c_str());
  EXPECT_TRUE(says(e, "(stated as 30.0)")) << e.model;
  EXPECT_TRUE(warned(e, ModulusFlag::kElevation)) << e.model;
  EXPECT_NEAR(background(e, pressed.measured) / kModulusPa, 1, 0.1) << e.model;
}

// A tissue that ends or slides may explain in part what a wrong face leaves.
TEST(ProbeFit, AFaceStatedTooLongIsFoundAndSaid) {
  for (const ProbeFace& of : {face(), face(0.007), face(0.015, true)}) {
    const Pressed pressed(of);
    for (const double too_long : {1.75, 1.0}) {
      const ModulusEstimate e = pressed.estimate({}, {}, kDepthM, {}, too_long * kElevationM);
      std::printf("background %.2f kPa, %d solves: %s\n", 1e-3 * background(e, pressed.measured), e.solves,
                  e.model.c_str());
      EXPECT_EQ(warned(e, ModulusFlag::kElevation), too_long > 1) << e.model;
      EXPECT_NEAR(background(e, pressed.measured) / kModulusPa, 1, too_long > 1 ? 0.2 : 0.1) << e.model;
    }
  }
}

// Rounding must not tell the cells of a depth from those of the image: 15 mm once did.
TEST(ProbeFit, ADepthWithinTheImageIsAnswered) {
  const Pressed pressed(face());
  for (const double depth_m : {0.013, 0.015}) {
    const ModulusEstimate e = pressed.estimate({}, {}, depth_m);
    EXPECT_TRUE(warned(e, ModulusFlag::kElevation)) << e.model;
    EXPECT_NEAR(background(e, pressed.measured) / kModulusPa, 1, 0.1) << e.model;
  }
}

// Tissue that softens with depth strains as tissue that ends beside the probe does, nearly. Which of the two
// it is decides the modulus that goes with the force, so what is stated must hold both.
TEST(ProbeFit, AModulusThatFallsWithDepthIsNotTakenForSides) {
  for (const double falls : {1.6, 2.0}) {
    const auto graded = [&](double, double y) { return -std::log(falls) * (y / kDepthM - 0.5); };
    const Pressed pressed(
        face(), [](double, double) { return 1.0; }, graded);
    const ModulusEstimate e = pressed.estimate();
    const double found = background(e, pressed.measured) / kModulusPa;
    std::vector<float> deviations;
    for (std::size_t n = 0; n < pressed.measured.grid.size(); ++n)
      if (pressed.measured.grid.y_m(n) > 0.003 && std::isfinite(e.log_deviation[n]))
        deviations.push_back(e.log_deviation[n]);
    std::nth_element(deviations.begin(), deviations.begin() + deviations.size() / 2, deviations.end());
    const double stated = deviations[deviations.size() / 2];
    std::printf("falls by %.1f: background %.2f, stated %.2f: %s\n", falls, found, stated, e.model.c_str());
    EXPECT_TRUE(says(e, "continues beside the probe")) << e.model;
    EXPECT_GE(stated, 0.12) << "of either";
    EXPECT_NEAR(found, 1, 0.2) << e.model;
    EXPECT_LE(std::abs(std::log(found)), 2 * stated) << e.model;
  }
}

// Without the solves for them no sides are tried: the tissue goes on, as usual. What is left over is said,
// and what was not tried is in the deviation.
TEST(ProbeFit, TriesNoSidesWithoutTheSolves) {
  const Pressed pressed(face(0.014, true));
  const ModulusEstimate e = pressed.estimate({.solves = 20});
  EXPECT_FALSE(says(e, "ends some")) << e.model;
  EXPECT_TRUE(warned(e, ModulusFlag::kMisfit)) << e.model;
  EXPECT_TRUE(warned(e, ModulusFlag::kCut)) << e.model;
  EXPECT_LE(e.solves, 20);
  EXPECT_FALSE(std::ranges::any_of(e.log_deviation, [](float deviation) { return deviation < 0.3F; }));
}

// Under a face that leans no other tissue is tried. What that leaves open is the models', whatever else
// warns.
TEST(ProbeFit, WhatALeaningFaceLeavesUntriedIsTheModels) {
  const auto strained = [](double lean, double texture) {
    return [=](double x_m, double y_m) {
      return (1 + lean * (2 * x_m / kWidthM - 1)) *
             std::exp(texture * std::sin(600 * x_m) * std::cos(500 * y_m));
    };
  };
  const ModulusEstimate both = Pressed(face(), strained(0.28, 0.3)).estimate(),
                        leaning = Pressed(face(), strained(0.28, 0)).estimate();
  EXPECT_GE(both.model_deviation, 0.3) << both.model;
  EXPECT_LT(leaning.model_deviation, 0.1) << leaning.model;
}

// What an estimate finds does not depend on what is kept of the pair before, and no fit solves more than it
// may.
TEST(ProbeFit, CountsTheSameForAPairAsOftenAsItComes) {
  const Pressed pressed(face(0.014, true));
  TissueExtent tissue{0.1, kDepthM, 0.035, 0.49, Plane::kSolid, kElevationM};
  const auto method = make_solid(imaging_device()->queue(), {});
  for (const ModulusBudget& budget : {ModulusBudget{.solves = 10}, ModulusBudget{}}) {
    const auto estimate = [&] {
      return method->estimate({pressed.measured, kWidthM, tissue, pressed.force, {}, budget});
    };
    method->forget();
    const ModulusEstimate first = estimate(), again = estimate();
    EXPECT_LT(again.solves, first.solves) << "the answers of the pair before are kept";
    EXPECT_EQ(again.iterations, first.iterations);
    EXPECT_EQ(again.model, first.model);
    for (std::size_t n = 0; n < first.youngs_modulus.size(); ++n) {
      if (std::isnan(first.youngs_modulus[n])) continue;
      EXPECT_EQ(again.youngs_modulus[n], first.youngs_modulus[n]);
      EXPECT_EQ(again.log_deviation[n], first.log_deviation[n]);
    }
  }
  for (const auto& [depths, pad] : {std::pair(0., false), {1, false}, {1.5, false}, {0, true}}) {
    tissue.depth_stated = depths > 0, tissue.depth_m = std::max(depths, 1.) * kDepthM;
    if (pad) tissue.pad = StandoffPad{0.007, 2 * kModulusPa, 0.0004, 0.1 * kModulusPa};
    const ModulusInput in{pressed.measured, kWidthM, tissue, std::nullopt, {}};
    ProbeFitter fitter(imaging_device()->queue(), {}, std::make_shared<StripCache>());
    for (const FitEffort effort : {FitEffort::kUsual, FitEffort::kWeighed, FitEffort::kAllStarts}) {
      fitter.forget();
      EXPECT_LE(fitter.fit(in, 0, -1, effort).solves, ProbeFitter::max_solves(effort, pad));
    }
  }
}

// Where it hardly strains it would bear most of the force, if it were tissue under the face. A stiff
// inclusion bears little more than its share.
TEST(ProbeFit, WhatHardlyStrainsAndWouldBearTheForceIsSaid) {
  const auto said = [](const Pressed& pressed) {
    const ModulusEstimate e = pressed.estimate();
    return std::any_of(e.warnings.begin(), e.warnings.end(), [](const Warning& w) {
      return w.flag == ModulusFlag::kMisfit && w.text.find("seems not to touch") != std::string::npos;
    });
  };
  EXPECT_TRUE(said(Pressed(face(0), [](double x, double) { return x > 0.024 ? 0.02 : 1; })));
  const auto even = [](double, double) { return 1.0; };
  const auto lump = [](double x, double y) { return std::hypot(x - 0.015, y - 0.01) < 0.005 ? 2.3 : 0; };
  for (const ProbeFace& f : {face(), face(0)}) EXPECT_FALSE(said(Pressed(f, even, lump)));
}

// Strain that no tissue of the model shows.
TEST(ProbeFit, WhatNothingExplainsIsAMisfit) {
  const Pressed pressed(face(), [](double x, double) { return 1 + 0.5 * std::sin(x / 0.8e-3); });
  const ModulusEstimate e = pressed.estimate();
  EXPECT_TRUE(warned(e, ModulusFlag::kMisfit)) << e.model;
}

// Columns that strain differently from top to bottom, by 5 %: no modulus explains them, and steps that go on
// trying lead ever farther away, to 0.86 after 24.
TEST(ProbeFit, WhereStepsDoNotSettleTheLikeliestMapIsKept) {
  const auto truth = [](double x, double y) {
    return 0.7 * (0.5 - y / kDepthM) + (std::hypot(x - 0.012, y - 0.011) < 0.004 ? 1.7 : 0);
  };
  const Pressed pressed(
      face(), [](double x, double) { return 1 + 0.05 * std::sin(x / 3e-3); }, truth);
  const ModulusEstimate e = pressed.estimate();
  const ImageGrid& grid = pressed.measured.grid;
  const double level = background(e, pressed.measured);
  double squares = 0, count = 0;
  for (std::size_t n = 0; n < grid.size(); ++n)
    if (grid.y_m(n) > 0.003 && std::isfinite(e.youngs_modulus[n]))
      squares += std::pow(std::log(e.youngs_modulus[n] / level) - truth(grid.x_m(n), grid.y_m(n)), 2),
          ++count;
  EXPECT_TRUE(warned(e, ModulusFlag::kDeadline));
  EXPECT_LE(std::sqrt(squares / count), 0.45);
}

}  // namespace
}  // namespace teletact::service
