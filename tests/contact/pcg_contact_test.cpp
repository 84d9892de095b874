// Contact through device PCG against the dense KKT reference, in every precision, and against the condensed
// path.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "service/contact/contact.h"
#include "service/tissue/elasticity_solver.h"
#include "tests/reference/contact.h"
#include "tests/tissue/tissue_cases.h"

namespace teletact {
namespace {

using service::Compliance;
using service::ContactPose;
using service::Device;
using service::ElasticitySolverOptions;
using service::Fingertip;
using service::FingertipShape;
using service::Friction;
using service::SolvePrecision;
using service::TissueModel;

std::shared_ptr<Device> device() {
  static const std::shared_ptr<Device> opened = Device::open();
  return opened;
}

std::vector<Fingertip> every_tip() {
  std::vector<Fingertip> tips;
  for (Friction friction : {Friction::kFrictionless, Friction::kStuck}) {
    tips.push_back({.shape = FingertipShape::kNode, .friction = friction});
    tips.push_back({.shape = FingertipShape::kNode, .friction = friction, .footprint_m = 2e-3});
    tips.push_back(
        {.shape = FingertipShape::kFlatPunch, .friction = friction, .radius_m = 3e-3, .half_width_m = 6e-3});
    tips.push_back({.shape = FingertipShape::kRoundedTip, .friction = friction, .radius_m = 10e-3});
  }
  return tips;
}

struct Worst {
  double error = 0, over_stated = 0;
};

// Largest force error over all contact kinds, and its largest share of what the answer states.
Worst worst_error(std::size_t rows, double nu, double contrast, std::size_t line, SolvePrecision precision) {
  const auto grid = tests::uniform_grid(51, rows, 2e-3);
  const auto material = tests::inclusion(grid, contrast, nu);
  const TissueModel model(grid, material, {}, {});
  ElasticitySolverOptions options;
  options.precision = precision;
  const auto compliance = model.iterative(line, device(), options);
  const reference::TouchedTissue tissue{grid, material, {}, line, model.options().thickness_m};
  Worst worst;
  for (const Fingertip& tip : every_tip()) {
    const ContactPose pose{0.0437, 0.0021};
    const auto expected = reference::touch(tissue, tip, pose, reference::KktMethod::kSparseFactor);
    const auto answer = service::solve_contact(model, line, *compliance, tip, pose);
    const double error =
        std::hypot(answer.force_n[0] - expected.force_n[0], answer.force_n[1] - expected.force_n[1]) /
        std::hypot(expected.force_n[0], expected.force_n[1]);
    const std::string where = "51x" + std::to_string(rows) + " nu " + std::to_string(nu) + " contrast " +
                              std::to_string(contrast) + " shape " + std::to_string(int(tip.shape)) +
                              " friction " + std::to_string(int(tip.friction));
    EXPECT_LE(error, precision == SolvePrecision::kFloat ? 2e-3 : 1e-6) << where;
    // Answers state the error of the solve. Reference and model assemble K each in its own order of sums;
    // what that rounds off is amplified by 1 / (1 - 2 nu) and the contrast. (A reference in long double
    // differs by the same 5e-11 at most.)
    constexpr double kAssembly = 1e-10;
    EXPECT_LE(error, answer.solve.relative_error + kAssembly) << where;
    EXPECT_TRUE(answer.solve.converged) << where << ": " << answer.solve.reason;
    EXPECT_GE(answer.solve.iterations, 1u);
    worst.error = std::max(worst.error, error);
    worst.over_stated = std::max(worst.over_stated, error / (answer.solve.relative_error + kAssembly));
  }
  return worst;
}

class ByPcg : public testing::TestWithParam<SolvePrecision> {};

TEST_P(ByPcg, ForceEqualsReferenceWithinWhatItStates) {
  if (GetParam() == SolvePrecision::kDouble && !device()->info().has_double)
    GTEST_SKIP() << "device without double";
  Worst worst;
  const auto add = [&](const Worst& w) {
    worst = {std::max(worst.error, w.error), std::max(worst.over_stated, w.over_stated)};
  };
  for (double nu : {0.3, 0.49, 0.495}) {
    for (double contrast : {1.0, 10.0, 100.0}) add(worst_error(8, nu, contrast, 0, GetParam()));
  }
  add(worst_error(11, 0.49, 10, 3, GetParam()));
  add(worst_error(16, 0.3, 100, 0, GetParam()));
  add(worst_error(21, 0.495, 100, 0, GetParam()));
  printf("largest relative force error %.2e, at most %.2f of what is stated\n", worst.error,
         worst.over_stated);
}

INSTANTIATE_TEST_SUITE_P(Contact, ByPcg,
                         testing::Values(SolvePrecision::kFloat, SolvePrecision::kDouble,
                                         SolvePrecision::kRefined),
                         [](const auto& instance) {
                           return std::string(instance.param == SolvePrecision::kFloat    ? "Float"
                                              : instance.param == SolvePrecision::kDouble ? "Double"
                                                                                          : "Refined");
                         });

TEST(IterativeCompliance, IsKeptByTheModelAndGrowsByColumns) {
  const auto grid = tests::uneven_grid(31, 12);
  const TissueModel model(grid, tests::scattered(grid, 10, 0.49), {}, {});
  for (std::size_t line : {0u, 5u}) {
    const auto compliance = model.iterative(line, device());
    EXPECT_EQ(compliance.get(), model.iterative(line, device()).get());
    const std::vector<std::size_t> few{9, 10}, more{3, 9, 10, 11, 30};
    service::SolveReport report;
    const Eigen::MatrixXd axial = compliance->axial_among(few, &report);
    const Eigen::MatrixXd first = compliance->among(few, &report), s = compliance->among(more, &report);
    const Eigen::MatrixXd expected = model.condensed(line)->among(more, nullptr);
    for (Eigen::Index a = 0; a < s.rows(); ++a) {
      for (Eigen::Index b = 0; b < s.cols(); ++b) {
        const double scale = std::sqrt(expected(a, a) * expected(b, b));
        EXPECT_LE(std::abs(s(a, b) - expected(a, b)), 1e-9 * scale) << a << " " << b;
        EXPECT_EQ(s(a, b), s(b, a));
      }
    }
    EXPECT_EQ(axial(0, 1), first(1, 3));
    EXPECT_EQ(first(0, 3), s(2, 5));
  }
  EXPECT_THROW(model.iterative(11, device()), std::out_of_range);
  EXPECT_THROW(model.iterative(0, device())->among(std::vector<std::size_t>{31}, nullptr), std::out_of_range);
}

}  // namespace
}  // namespace teletact
