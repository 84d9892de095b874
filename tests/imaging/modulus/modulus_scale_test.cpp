// What only shows in the scale of the modulus (T3.4): a wrong force in one window, which its neighbours tell,
// and nu near 1/2 in confined tissue, where pressure carries the load.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <vector>

#include "tests/imaging/modulus/modulus_phantom.h"

namespace teletact::service {
namespace {

bool flagged(const ModulusEstimate& e, ModulusFlag flag) {
  return std::any_of(e.warnings.begin(), e.warnings.end(),
                     [=](const Warning& w) { return w.flag == flag && !w.text.empty(); });
}

double median(const Field& field) {
  std::vector<float> said;
  std::copy_if(field.begin(), field.end(), std::back_inserter(said),
               [](float v) { return std::isfinite(v); });
  const auto middle = said.begin() + static_cast<std::ptrdiff_t>(said.size() / 2);
  std::nth_element(said.begin(), middle, said.end());
  return *middle;
}

class Scale : public ::testing::TestWithParam<ModulusKind> {};

constexpr double kBesideM = 0.060;  // the window to the left of the one at 0.120 m

// Patients with an inclusion away from the border of the two windows, across it and close to it.
const std::vector<PhantomOptions> kPatients{{.x_m = 0.150, .contrast = 3, .seed = 2},
                                            {.x_m = 0.120, .diameter_m = 0.013, .contrast = 5, .seed = 3},
                                            {.x_m = 0.128, .y_m = 0.010, .contrast = 10, .seed = 4}};

// Forces that are seen: in the window's own place, and beside a neighbour with any of these inclusions
// between them. The reference stress throws shadows at a border: there it sees nothing, nor does it raise an
// alarm.
struct Seen {
  double again, beside;
};
Seen seen_by(ModulusKind kind) {
  if (kind == ModulusKind::kReferenceStress) return {1.4, 0};
  return kind == ModulusKind::kDirect ? Seen{1.35, 1.5} : Seen{1.25, 1.4};
}

TEST_P(Scale, AWrongForceInOneWindowIsFlaggedAndNothingElse) {
  for (const PhantomOptions& options : kPatients) {
    PhantomOptions beside = options, again = options;
    beside.window_m = kBesideM, beside.seed += 10, again.seed += 20;
    for (const PhantomOptions& before : {beside, again}) {
      Phantom known(before), window(options);
      window.known = known_from(known, known.estimate(GetParam()));
      const double right_n = window.force->force_n;
      const auto alarm = [&](double factor) {
        window.force->force_n = factor * right_n;
        return flagged(window.estimate(GetParam()), ModulusFlag::kScale);
      };
      EXPECT_FALSE(alarm(1)) << options.x_m;
      const Seen seen = seen_by(GetParam());
      const double factor = before.window_m == kBesideM ? seen.beside : seen.again;
      if (factor == 0) continue;
      EXPECT_TRUE(alarm(factor)) << options.x_m << " x " << factor;
      EXPECT_TRUE(alarm(1 / factor)) << options.x_m << " / " << factor;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, Scale,
                         ::testing::Values(ModulusKind::kReferenceStress, ModulusKind::kDirect,
                                           ModulusKind::kIterative));

// A force 1.3 times too large between two neighbours. A window that was found doubtful claims less, and does
// not make its right neighbours doubtful in turn.
TEST(Scale, TheDoubtIsInTheDeviationAndEndsThere) {
  Phantom left({.window_m = kBesideM}), wrong({.seed = 2}), right({.seed = 3, .window_m = 0.180});
  const ModulusEstimate first = left.estimate(ModulusKind::kIterative);
  const double claimed = median(wrong.estimate(ModulusKind::kIterative).log_deviation);
  wrong.known = known_from(left, first);
  wrong.force->force_n *= 1.3;
  const ModulusEstimate doubtful = wrong.estimate(ModulusKind::kIterative);
  ASSERT_TRUE(flagged(doubtful, ModulusFlag::kScale));
  EXPECT_NEAR(median(doubtful.log_deviation), std::hypot(claimed, std::log(1.3)), 0.05);
  right.known = known_from(wrong, doubtful);
  EXPECT_FALSE(flagged(right.estimate(ModulusKind::kIterative), ModulusFlag::kScale));
}

// A relative modulus has no scale to be wrong.
TEST(Scale, WithoutForceNothingIsCompared) {
  Phantom known({.window_m = kBesideM}), window({});
  window.known = known_from(known, known.estimate(ModulusKind::kDirect));
  window.force.reset();
  EXPECT_FALSE(flagged(window.estimate(ModulusKind::kDirect), ModulusFlag::kScale));
}

class Confined : public ::testing::TestWithParam<ModulusKind> {};

// A thin layer under a wide probe: the same displacement and force, nu .49 and .4999 stated, give moduli that
// differ by more than a tenth; both are flagged and claim no more than they know. 40 mm deep tissue gives way
// sideways.
TEST_P(Confined, ThinLayersNearIncompressibilityAreFlagged) {
  PhantomOptions thin{.y_m = 0.005, .diameter_m = 0.004, .push_m = 0.1e-3};
  thin.depth_m = 0.010;
  Phantom deep({}), shallow(thin);
  deep.tissue.poisson_std = shallow.tissue.poisson_std = 0.01;
  std::vector<Field> maps;
  for (const int k : {0, 1}) {
    deep.tissue.poisson_ratio = shallow.tissue.poisson_ratio = k ? 0.4999 : 0.49;
    EXPECT_FALSE(flagged(deep.estimate(GetParam()), ModulusFlag::kPressure));
    const ModulusEstimate e = shallow.estimate(GetParam());
    EXPECT_TRUE(flagged(e, ModulusFlag::kPressure)) << shallow.tissue.poisson_ratio;
    EXPECT_GE(median(e.log_deviation), 0.1);
    maps.push_back(e.youngs_modulus);
    std::printf("10 mm deep, nu %.4f: background %.0f Pa\n", shallow.tissue.poisson_ratio, e.background);
  }
  double squares = 0, count = 0;
  for (std::size_t n = 0; n < maps[0].size(); ++n)
    if (std::isfinite(maps[0][n]) && std::isfinite(maps[1][n]))
      squares += std::pow(std::log(maps[1][n] / maps[0][n]), 2), ++count;
  const double difference = std::sqrt(squares / count);
  std::printf("they differ by %.3f of log E (rms)\n", difference);
  EXPECT_GE(difference, 0.1);
}

INSTANTIATE_TEST_SUITE_P(Methods, Confined,
                         ::testing::Values(ModulusKind::kReferenceStress, ModulusKind::kDirect,
                                           ModulusKind::kIterative));

// The slope that the flag is judged by, against whole solves.
TEST(Confined, TheForceFollowsThePoissonRatioAsSaid) {
  for (const Plane plane : {Plane::kStrain, Plane::kStress})
    for (const double nu : {0.0, 0.3, 0.49, 0.4999}) {
      const auto force = [&](double at) {
        StripModel model({0.160, 0.020, 0.050, at, plane}, 0.060);
        return model.solve(std::vector<double>(model.grid().elements(), 1.0)).force_n_per_m;
      };
      const double step = 1e-3 * (0.5 - nu), from = std::max(0.0, nu - step);
      StripModel model({0.160, 0.020, 0.050, 0.5 * (from + nu + step), plane}, 0.060);
      const StripResponse homogeneous = model.solve(std::vector<double>(model.grid().elements(), 1.0));
      const double want = std::log(force(nu + step) / force(from)) / (nu + step - from);
      EXPECT_NEAR(model.log_force_slope(homogeneous), want, 1e-3 * std::abs(want)) << nu;
    }
}

}  // namespace
}  // namespace teletact::service
