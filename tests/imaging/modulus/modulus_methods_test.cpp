// The direct and the iterative modulus (T3.2, T3.3) on windows of the simulated patient.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <vector>

#include "tests/imaging/modulus/modulus_phantom.h"

namespace teletact::service {
namespace {

double median(std::vector<double> values) {
  if (values.empty()) return std::nan("");
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Otsu's threshold: the one that parts the values into the two classes that differ most.
double otsu(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const double total = std::accumulate(values.begin(), values.end(), 0.0), count = double(values.size());
  double sum = 0, best = -1, threshold = values.front();
  for (std::size_t k = 1; k < values.size(); ++k) {
    sum += values[k - 1];
    const double below = double(k) / count,
                 difference = sum / double(k) - (total - sum) / (count - double(k));
    const double between = below * (1 - below) * difference * difference;
    if (between > best) best = between, threshold = 0.5 * (values[k - 1] + values[k]);
  }
  return threshold;
}

struct Score {
  double background = 0, contrast = 0, dice = 0, standard_error = 0;
};

// As T3.3 defines them; standard_error: rms of log(E / truth) / deviation beyond 1 mm from the border.
Score score(const Phantom& p, const ModulusEstimate& e) {
  std::vector<double> inside, background, logarithms;
  double squares = 0, count = 0;
  for (std::size_t n = 0; n < p.grid.size(); ++n) {
    if (!std::isfinite(e.youngs_modulus[n])) continue;
    const double from_border_m = (p.radii(n) - 1) * p.options.diameter_m / 2;
    logarithms.push_back(std::log(e.youngs_modulus[n]));
    if (p.radii(n) < 0.7) inside.push_back(e.youngs_modulus[n]);
    if (from_border_m > 0.002) background.push_back(e.youngs_modulus[n]);
    if (std::abs(from_border_m) < 0.001) continue;
    squares += std::pow(std::log(e.youngs_modulus[n] / p.truth(n)) / e.log_deviation[n], 2), ++count;
  }
  const double threshold = otsu(logarithms);
  double both = 0, either = 0;
  for (std::size_t n = 0; n < p.grid.size(); ++n) {
    if (!std::isfinite(e.youngs_modulus[n])) continue;
    const bool stiff = std::log(e.youngs_modulus[n]) > threshold, is = p.radii(n) < 1;
    both += stiff && is, either += stiff, either += is;
  }
  return {median(background), median(inside) / median(background), 2 * both / either,
          std::sqrt(squares / count)};
}

struct Recovery {
  ModulusKind kind;
  double contrast, least, most;
  PhantomOptions of = {};
};

// The largest that is promised, nearest to the border, whose modulus and pressure it changes most.
constexpr PhantomOptions kLarge{.y_m = 0.015, .diameter_m = 0.015};

class Recovers : public ::testing::TestWithParam<Recovery> {};

// The targets of one seed; the bench runs twenty.
TEST_P(Recovers, ContrastBackgroundAndShape) {
  const Recovery r = GetParam();
  PhantomOptions options = r.of;
  options.contrast = r.contrast;
  Phantom phantom(options);
  const ModulusEstimate e = phantom.estimate(r.kind);
  const Score s = score(phantom, e);
  std::printf("contrast %.2f of %.0f, background %.0f Pa, Dice %.3f, standardised error %.2f, %d steps\n",
              s.contrast, r.contrast, s.background, s.dice, s.standard_error, e.iterations);
  EXPECT_EQ(e.kind, r.kind);
  EXPECT_TRUE(e.absolute && e.converged);
  EXPECT_GE(s.contrast, r.least * r.contrast);
  EXPECT_LE(s.contrast, r.most * r.contrast);
  EXPECT_NEAR(s.background, Phantom::kBackgroundPa, 0.05 * Phantom::kBackgroundPa);
  EXPECT_GE(s.dice, 0.85);
  EXPECT_GE(s.standard_error, 0.4);
  EXPECT_LE(s.standard_error, 2);
  for (const Warning& w : e.warnings) ADD_FAILURE() << w.text;
}

INSTANTIATE_TEST_SUITE_P(Methods, Recovers,
                         ::testing::Values(Recovery{ModulusKind::kDirect, 2, 0.85, 1.15},
                                           Recovery{ModulusKind::kDirect, 3, 0.85, 1.15},
                                           Recovery{ModulusKind::kDirect, 5, 0.7, 1.15},
                                           Recovery{ModulusKind::kDirect, 10, 0.5, 1.15},
                                           Recovery{ModulusKind::kDirect, 2, 0.9, 1.15, kLarge},
                                           Recovery{ModulusKind::kDirect, 3, 0.9, 1.15, kLarge},
                                           Recovery{ModulusKind::kDirect, 5, 0.8, 1.15, kLarge},
                                           Recovery{ModulusKind::kDirect, 10, 0.7, 1.15, kLarge},
                                           Recovery{ModulusKind::kIterative, 2, 0.85, 1.1},
                                           Recovery{ModulusKind::kIterative, 3, 0.85, 1.1},
                                           Recovery{ModulusKind::kIterative, 5, 0.85, 1.1},
                                           Recovery{ModulusKind::kIterative, 10, 0.75, 1.15}));

// The first border is the reference stress's, too soft where an inclusion is near; without one it stays.
TEST(Direct, CorrectsItsBorderUntilThatHasSettled) {
  const auto contrast = [](const PhantomOptions& of, int corrections, double settled) {
    Phantom phantom(of);
    DirectOptions options;
    options.max_corrections = corrections, options.settled = settled;
    const ModulusEstimate e = make_direct(imaging_device()->queue(), options)->estimate(phantom.input());
    std::vector<double> inside, outside;
    for (std::size_t n = 0; n < phantom.grid.size(); ++n)
      if (std::isfinite(e.youngs_modulus[n]))
        (phantom.radii(n) < 0.7 ? inside : outside).push_back(e.youngs_modulus[n]);
    return median(inside) / median(outside);
  };
  const double once = contrast(kLarge, 0, 0), twice = contrast(kLarge, 1, 0), often = contrast(kLarge, 10, 0),
               settled = contrast(kLarge, 10, DirectOptions{}.settled);
  std::printf("contrast of 3: %.3f, %.3f after a correction, %.3f after ten, %.3f until settled\n", once,
              twice, often, settled);
  EXPECT_LT(once, 0.88 * 3);
  EXPECT_GT(twice, once + 0.1);
  EXPECT_NEAR(often, 3, 0.1);
  EXPECT_NEAR(settled, often, 0.03 * 3);
  const PhantomOptions none{.contrast = 1};
  EXPECT_EQ(contrast(none, 10, DirectOptions{}.settled), contrast(none, 0, 0));
}

// Uniform strain without any lateral motion is none of wide bonded tissue: every border asks for another.
TEST(Direct, StopsWhereCorrectionsLeadNowhere) {
  Phantom phantom({});
  for (std::size_t n = 0; n < phantom.grid.size(); ++n)
    phantom.axial[n] = -0.01 * phantom.y(n), phantom.lateral[n] = 0;
  const auto map = [&](int corrections) {
    DirectOptions options;
    options.max_corrections = corrections;
    return make_direct(imaging_device()->queue(), options)->estimate(phantom.input()).youngs_modulus;
  };
  const Field once = map(1), often = map(10);
  for (std::size_t n = 0; n < once.size(); ++n)
    EXPECT_TRUE(once[n] == often[n] || (std::isnan(once[n]) && std::isnan(often[n]))) << n;
}

TEST(Methods, WithoutForceTheModulusIsRelativeAndSaysSo) {
  for (const ModulusKind kind : {ModulusKind::kDirect, ModulusKind::kIterative}) {
    Phantom phantom({});
    phantom.force.reset();
    const ModulusEstimate e = phantom.estimate(kind);
    EXPECT_FALSE(e.absolute);
    EXPECT_EQ(e.background, 1);
    EXPECT_NEAR(score(phantom, e).contrast, 3, 0.45);
  }
}

// The forward model holds for every nu; measured strain never meets lambda = E nu / ((1 + nu)(1 - 2 nu)),
// which would multiply its noise by 49.5 at nu = .495 (T3.2).
TEST(Methods, NearIncompressibleTissueBlowsNothingUp) {
  for (const ModulusKind kind : {ModulusKind::kDirect, ModulusKind::kIterative})
    for (const double nu : {0.48, 0.495, 0.4999}) {
      Phantom phantom({});
      phantom.tissue.poisson_ratio = nu;  // of the patient .49
      const Score s = score(phantom, phantom.estimate(kind));
      std::printf("nu %.4f: contrast %.2f of 3, background %.0f Pa\n", nu, s.contrast, s.background);
      EXPECT_NEAR(s.contrast, 3, 0.45) << nu;
      EXPECT_NEAR(s.background, Phantom::kBackgroundPa, 0.12 * Phantom::kBackgroundPa) << nu;
    }
}

// The strip's own displacement, nu from .3 to .4999, both planes: the equations themselves.
TEST(Methods, RecoverTheStripAtAnyPoissonRatio) {
  for (const Plane plane : {Plane::kStrain, Plane::kStress})
    for (const double nu : {0.3, 0.45, 0.4999}) {
      Phantom phantom({.noise_m = 0.1e-6});
      phantom.tissue.poisson_ratio = nu, phantom.tissue.plane = plane;
      phantom.take_from_strip();
      for (const ModulusKind kind : {ModulusKind::kDirect, ModulusKind::kIterative}) {
        const ModulusEstimate estimate = phantom.estimate(kind);
        const Score s = score(phantom, estimate);
        std::printf("%s, nu %.4f, method %d: contrast %.2f of 3, background %.0f Pa\n",
                    plane == Plane::kStrain ? "plane strain" : "plane stress", nu, int(kind), s.contrast,
                    s.background);
        EXPECT_NEAR(s.contrast, 3, 0.5) << nu;
        EXPECT_NEAR(s.background, Phantom::kBackgroundPa, 0.06 * Phantom::kBackgroundPa) << nu;
      }
    }
}

// GIVEN a budget of so many steps, THEN it takes no more, returns its best and says so.
TEST(Iterative, TakesTheStepsItHasAndSaysSo) {
  Phantom phantom({.contrast = 10});
  const auto method = make_iterative(imaging_device()->queue());
  for (const int steps : {0, 1, 3, ModulusBudget::kAll}) {
    ModulusInput in = phantom.input();
    in.budget.steps = steps, in.budget.why_steps = "0.10 s are left";
    const ModulusEstimate e = method->estimate(in);
    const auto warned = std::ranges::find(e.warnings, ModulusFlag::kCut, &Warning::flag);
    const bool all = steps == ModulusBudget::kAll;
    EXPECT_EQ(warned == e.warnings.end(), all) << steps;
    EXPECT_EQ(e.converged, all) << steps;
    EXPECT_EQ(e.kind, steps == 0 ? ModulusKind::kDirect : ModulusKind::kIterative) << steps;
    if (!all) {
      EXPECT_EQ(e.iterations, steps);
      EXPECT_NE(warned->text.find("0.10 s are left"), std::string::npos) << warned->text;
    }
    if (steps == 0) {  // then it is the direct one that it starts from
      DirectOptions start;
      start.max_corrections = 1;
      const Field direct = make_direct(imaging_device()->queue(), start)->estimate(in).youngs_modulus;
      for (std::size_t n = 0; n < direct.size(); ++n)
        EXPECT_TRUE(direct[n] == e.youngs_modulus[n] ||
                    (std::isnan(direct[n]) && std::isnan(e.youngs_modulus[n])));
    }
  }
}

}  // namespace
}  // namespace teletact::service
