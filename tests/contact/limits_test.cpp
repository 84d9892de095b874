// The contact at the limits of what a tissue can be: each case has an answer that the reference confirms, or
// is refused by name.
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>
#include <string>

#include "service/contact/contact.h"
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

TEST(ContactLimits, ContrastOf1e8IsAnsweredWithinWhatItStatesOrRefused) {
  const TissueGrid grid = tests::uniform_grid(21, 11);
  for (double nu : {0.3, 0.49, 0.4999}) {
    try {
      const TissueModel model(grid, tests::scattered(grid, 1e8, nu), {}, {});
      const ContactPose pose{0.0103, 0.002};
      const double error = force_error(model, {}, pose), stated = press(model, {}, pose).solve.relative_error;
      EXPECT_LE(error, stated) << "nu " << nu;
    } catch (const std::domain_error& refused) {
      EXPECT_NE(std::string(refused.what()).find("contrast"), std::string::npos) << refused.what();
    }
  }
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
