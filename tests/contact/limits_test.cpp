// The contact at the limits of what a tissue can be: each case has an answer that the reference confirms, or
// is refused by name.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "service/contact/contact.h"
#include "service/tissue/tissue_model.h"
#include "tests/contact/exact_compliance.h"
#include "tests/reference/contact.h"
#include "tests/tissue/tissue_cases.h"

namespace teletact {
namespace {

using service::ContactAnswer;
using service::ContactState;
using service::Fingertip;
using service::FingertipShape;
using service::Friction;
using service::PlanePose;
using service::TissueGrid;
using service::TissueModel;

ContactAnswer press(const TissueModel& model, const Fingertip& tip, const PlanePose& pose) {
  return service::solve_contact(model.problem(), 0, *model.compliance(0), tip, pose);
}

double force_error(const TissueModel& model, const Fingertip& tip, const PlanePose& pose) {
  const reference::TouchedTissue tissue{model.problem().grid, model.problem().material,
                                        model.problem().supports, 0, model.problem().thickness_m};
  const auto expected = reference::touch(tissue, tip, pose, reference::KktMethod::kDense);
  const ContactAnswer answer = press(model, tip, pose);
  return std::hypot(answer.force_n[0] - expected.force_n[0], answer.force_n[1] - expected.force_n[1]) /
         std::hypot(expected.force_n[0], expected.force_n[1]);
}

struct Judged {
  double error = 0, stated = 0;  // against long double
};
Judged judged(const TissueModel& model, const Fingertip& tip, const PlanePose& pose) {
  tests::ExactCompliance exact(model.problem().grid, model.problem().material);
  const auto truth = service::solve_contact(model.problem(), 0, exact, tip, pose).force_n;
  const ContactAnswer answer = press(model, tip, pose);
  return {
      std::hypot(answer.force_n[0] - truth[0], answer.force_n[1] - truth[1]) / std::hypot(truth[0], truth[1]),
      answer.solve.relative_error};
}

// What is stated follows where double precision really loses digits.
TEST(ContactLimits, StatesRoundingAtAnyContrastAndPoissonRatio) {
  struct Case {
    double nu, contrast, min_error, max_error, max_stated;
  };
  const TissueGrid grid = tests::uniform_grid(21, 11);
  for (const Case& c : {Case{0.3, 1, 0, 1e-13, 1e-9},
                        {0.49, 10, 0, 1e-12, 1e-8},
                        {0.499, 1e3, 0, 1e-11, 1e-4},
                        {0.499999, 1e4, 1e-11, 1e-7, INFINITY},
                        {0.49999999, 1e8, 1e-8, 1e-4, INFINITY}}) {
    const TissueModel model(grid, tests::scattered(grid, c.contrast, c.nu), {}, {});
    const Judged j = judged(model, {}, {0.0103, 0.002});
    std::printf("nu %.8f: %.1e, stated %.1e\n", c.nu, j.error, j.stated);
    EXPECT_LE(j.error, j.stated) << c.nu << " " << c.contrast;
    EXPECT_GE(j.error, c.min_error) << c.nu << " " << c.contrast;
    EXPECT_LE(j.error, c.max_error) << c.nu << " " << c.contrast;
    EXPECT_LE(j.stated, c.max_stated) << c.nu << " " << c.contrast;
  }
}

// Where the bound ends.
TEST(ContactLimits, AnswersThatCannotBeTrustedSaySo) {
  const TissueGrid grid = tests::uniform_grid(21, 11);
  const TissueModel model(grid, tests::scattered(grid, 1e8, 0.4999), {}, {});
  EXPECT_GE(press(model, {}, {0.0103, 0.002}).solve.relative_error, 0.1);
}

// Compliances that no tissue has: an answer made of them must not leave.
class Unusable final : public service::Compliance {
 public:
  explicit Unusable(double value) : value_(value) {}
  Eigen::MatrixXd among(std::span<const std::size_t> nodes, service::SolveReport*) override {
    return Eigen::MatrixXd::Constant(2 * Eigen::Index(nodes.size()), 2 * Eigen::Index(nodes.size()), value_);
  }

  Eigen::MatrixXd axial_among(std::span<const std::size_t> nodes, service::SolveReport*) override {
    return Eigen::MatrixXd::Constant(Eigen::Index(nodes.size()), Eigen::Index(nodes.size()), value_);
  }

 private:
  double value_;
};

TEST(ContactLimits, AnswerThatIsNotFiniteIsRefused) {
  const TissueGrid grid = tests::uniform_grid(21, 11);
  const TissueModel model(grid, tests::inclusion(grid, 1, 0.49), {}, {});
  const double nan = std::numeric_limits<double>::quiet_NaN(),
               infinite = std::numeric_limits<double>::infinity();
  for (const double value : {nan, infinite, 0.0, 1e-310}) {  // 1e-310: its reciprocal is beyond double
    Unusable compliance(value);
    for (const FingertipShape shape :
         {FingertipShape::kNode, FingertipShape::kFlatPunch, FingertipShape::kRoundedTip})
      EXPECT_THROW(service::solve_contact(model.problem(), 0, compliance, {.shape = shape}, {0.0103, 0.002}),
                   std::domain_error)
          << value << " shape " << int(shape);
  }
}

// A compliance whose samples say that all is well.
class SampledCompliance final : public service::Compliance {
 public:
  SampledCompliance(std::shared_ptr<service::Compliance> exact, bool converged)
      : exact_(std::move(exact)), converged_(converged) {}
  Eigen::MatrixXd among(std::span<const std::size_t> nodes, service::SolveReport* report) override {
    return state(report), exact_->among(nodes, nullptr);
  }
  Eigen::MatrixXd axial_among(std::span<const std::size_t> nodes, service::SolveReport* report) override {
    return state(report), exact_->axial_among(nodes, nullptr);
  }
  std::optional<service::FormError> error_between(std::span<const std::size_t>, const Eigen::MatrixX2d&,
                                                  const Eigen::VectorXd&) const override {
    service::FormError error;
    error.rounding.assign(6, Eigen::Vector2d::Zero());
    return error;
  }
  static constexpr double kOwnBound = 0.01;

 private:
  void state(service::SolveReport* report) const {
    if (report) report->relative_error = kOwnBound, report->converged = converged_;
  }
  std::shared_ptr<service::Compliance> exact_;
  bool converged_;
};

TEST(ContactLimits, WhatDidNotConvergeStatesNoLessThanItsOwnBound) {
  const TissueGrid grid = tests::uniform_grid(21, 11);
  const TissueModel model(grid, tests::inclusion(grid, 5, 0.49), {}, {});
  const auto stated = [&](bool converged) {
    SampledCompliance compliance(model.compliance(0), converged);
    return service::solve_contact(model.problem(), 0, compliance, {}, {0.0103, 0.002}).solve.relative_error;
  };
  EXPECT_LE(stated(true), 1e-12);
  EXPECT_GE(stated(false), SampledCompliance::kOwnBound);
}

TEST(ContactLimits, GridOfOneElementIsTouched) {
  const TissueGrid grid = tests::uniform_grid(2, 2, 0.01);
  const TissueModel model(grid, tests::inclusion(grid, 1, 0.49), {}, {});
  for (double x : {0.0, 0.0031, 0.005, 0.01}) {
    const PlanePose pose{x, 0.002};
    EXPECT_EQ(press(model, {.radius_m = 0.1}, pose).state, ContactState::kContact) << x;
    EXPECT_LE(force_error(model, {.radius_m = 0.1}, pose), 1e-9) << x;
  }
  EXPECT_THROW(press(model, {}, {0.0101, 0.002}), std::out_of_range);
}

TEST(ContactLimits, TipWiderThanTheTissueTouchesAllOfIt) {
  const TissueGrid grid = tests::uniform_grid(13, 9);
  const TissueModel model(grid, tests::inclusion(grid, 5, 0.49), {}, {});
  for (Friction friction : {Friction::kFrictionless, Friction::kStuck}) {
    const Fingertip tip{.friction = friction, .radius_m = 0.5};
    for (double x : {0.0, 0.0047, 0.006, 0.012}) {
      const PlanePose pose{x, 0.001};
      EXPECT_LE(force_error(model, tip, pose), 1e-8) << x;
      EXPECT_EQ(press(model, tip, pose).pressure.size(), grid.nx());
    }
  }
}

}  // namespace
}  // namespace teletact
