// The contact at the limits of what a tissue can be: each case has an answer that the reference confirms, or
// is refused by name.
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "service/contact/contact.h"
#include "tests/contact/exact_compliance.h"
#include "tests/reference/contact.h"
#include "tests/tissue/tissue_cases.h"

namespace teletact {
namespace {

using service::ContactAnswer;
using service::ContactPose;
using service::ContactState;
using service::Fingertip;
using service::Friction;
using service::TissueGrid;
using service::TissueModel;

ContactAnswer press(const TissueModel& model, const Fingertip& tip, const ContactPose& pose) {
  return service::solve_contact(model, 0, *model.condensed(0), tip, pose);
}

double force_error(const TissueModel& model, const Fingertip& tip, const ContactPose& pose) {
  const reference::TouchedTissue tissue{model.grid(), model.material(), model.supports(), 0,
                                        model.options().thickness_m};
  const auto expected = reference::touch(tissue, tip, pose, reference::KktMethod::kDense);
  const ContactAnswer answer = press(model, tip, pose);
  return std::hypot(answer.force_n[0] - expected.force_n[0], answer.force_n[1] - expected.force_n[1]) /
         std::hypot(expected.force_n[0], expected.force_n[1]);
}

struct Sampled {
  double error = 0, stated = 0;  // against long double; once rounding is measured
};
Sampled sampled(const TissueModel& model, const Fingertip& tip, const ContactPose& pose) {
  while (model.measure_rounding(0)) {
  }
  tests::ExactCompliance exact(model.grid(), model.material());
  const auto truth = service::solve_contact(model, 0, exact, tip, pose).force_n;
  const ContactAnswer answer = press(model, tip, pose);
  return {
      std::hypot(answer.force_n[0] - truth[0], answer.force_n[1] - truth[1]) / std::hypot(truth[0], truth[1]),
      answer.solve.relative_error};
}

TEST(ContactLimits, ContrastOf1e8IsAnsweredWithinWhatItStates) {
  const TissueGrid grid = tests::uniform_grid(21, 11);
  for (double nu : {0.3, 0.49}) {
    const TissueModel model(grid, tests::scattered(grid, 1e8, nu), {}, {});
    const ContactPose pose{0.0103, 0.002};
    EXPECT_LE(force_error(model, {}, pose), press(model, {}, pose).solve.relative_error) << "nu " << nu;
  }
}

// The bound made beforehand, which that test holds, is 1e9 times the error; what is stated once rounding is
// measured can fail: it is within 1e-7, and where double precision really loses digits it follows.
TEST(ContactLimits, OnceRoundingIsMeasuredItIsStatedCloselyAtAnyContrast) {
  struct Case {
    double nu, contrast, least_error, most_error, most_stated;
  };
  const TissueGrid grid = tests::uniform_grid(21, 11);
  for (const Case& c : {Case{0.3, 1e8, 0, 1e-11, 1e-9},
                        {0.49, 1e8, 0, 1e-10, 1e-9},
                        {0.4999, 1e8, 0, 1e-9, 1e-7},
                        {0.499999, 1e4, 1e-11, 1e-7, 1e-6},
                        {0.49999999, 1e8, 1e-8, 1e-4, 1e-2}}) {
    const TissueModel model(grid, tests::scattered(grid, c.contrast, c.nu), {}, {});
    const Sampled s = sampled(model, {}, {0.0103, 0.002});
    EXPECT_LE(s.error, s.stated) << c.nu << " " << c.contrast;
    EXPECT_GE(s.error, c.least_error) << c.nu << " " << c.contrast;
    EXPECT_LE(s.error, c.most_error) << c.nu << " " << c.contrast;
    EXPECT_LE(s.stated, c.most_stated) << c.nu << " " << c.contrast;
  }
}

// Where the bound made beforehand ends, and the reference: before its rounding is measured.
TEST(ContactLimits, AnswersThatCannotBeTrustedSaySo) {
  const TissueGrid grid = tests::uniform_grid(21, 11);
  const TissueModel model(grid, tests::scattered(grid, 1e8, 0.4999), {}, {});
  EXPECT_GE(press(model, {}, {0.0103, 0.002}).solve.relative_error, 0.1);
}

TEST(ContactLimits, GridOfOneElementIsTouched) {
  const TissueGrid grid = tests::uniform_grid(2, 2, 0.01);
  const TissueModel model(grid, tests::inclusion(grid, 1, 0.49), {}, {});
  for (double x : {0.0, 0.0031, 0.005, 0.01}) {
    const ContactPose pose{x, 0.002};
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
      const ContactPose pose{x, 0.001};
      EXPECT_LE(force_error(model, tip, pose), 1e-8) << x;
      EXPECT_EQ(press(model, tip, pose).pressure.size(), grid.nx());
    }
  }
}

}  // namespace
}  // namespace teletact
