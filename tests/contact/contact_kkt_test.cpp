// Contact force through the condensed compliance against the dense KKT reference (T4.1), and the paper's
// table of touching under the surface (T6.3).
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <string>

#include "service/contact/contact.h"
#include "service/tissue/tissue_model.h"
#include "tests/reference/contact.h"
#include "tests/tissue/tissue_cases.h"

namespace teletact {
namespace {

using service::Fingertip;
using service::FingertipShape;
using service::Friction;
using service::Material;
using service::PlanePose;
using service::TissueGrid;
using service::TissueModel;

struct Kind {
  std::string name;
  Fingertip tip;
};

std::vector<Kind> every_kind() {
  std::vector<Kind> kinds;
  for (Friction friction : {Friction::kFrictionless, Friction::kStuck}) {
    const std::string suffix = friction == Friction::kStuck ? " stuck" : "";
    kinds.push_back({"node" + suffix, {.shape = FingertipShape::kNode, .friction = friction}});
    kinds.push_back(
        {"footprint" + suffix, {.shape = FingertipShape::kNode, .friction = friction, .footprint_m = 2e-3}});
    kinds.push_back({"punch" + suffix,
                     {.shape = FingertipShape::kFlatPunch,
                      .friction = friction,
                      .radius_m = 0.003,
                      .half_width_m = 0.006}});
    kinds.push_back(
        {"tip" + suffix, {.shape = FingertipShape::kRoundedTip, .friction = friction, .radius_m = 0.010}});
  }
  return kinds;
}

// Force of the product over the reference's, as a vector.
double force_error(const reference::TouchedTissue& tissue, TissueModel& model, const Kind& kind,
                   const PlanePose& pose, reference::KktMethod method) {
  const auto expected = reference::touch(tissue, kind.tip, pose, method);
  const auto answer =
      service::solve_contact(model.problem(), tissue.line, *model.compliance(tissue.line), kind.tip, pose);
  const double scale = std::hypot(expected.force_n[0], expected.force_n[1]);
  EXPECT_GE(scale, 1e-3);  // something is touched
  EXPECT_LE(std::abs(answer.energy_j - expected.energy_j), 1e-7 * expected.energy_j);
  return std::hypot(answer.force_n[0] - expected.force_n[0], answer.force_n[1] - expected.force_n[1]) / scale;
}

// The paper's sizes, 51 columns and 8 to 21 rows, 2 mm apart.
double worst_error(std::size_t rows, double nu, double contrast, std::size_t line,
                   reference::KktMethod method) {
  const TissueGrid grid = tests::uniform_grid(51, rows, 2e-3);
  const Material material = tests::inclusion(grid, contrast, nu);
  TissueModel model(grid, material, {}, {});
  const reference::TouchedTissue tissue{grid, material, {}, line, model.problem().thickness_m};
  double worst = 0;
  for (const Kind& kind : every_kind()) {
    const double error = force_error(tissue, model, kind, {0.0437, 0.0021}, method);
    EXPECT_LE(error, 1e-6) << kind.name << " 51x" << rows << " nu " << nu << " contrast " << contrast
                           << " line " << line;
    worst = std::max(worst, error);
  }
  return worst;
}

TEST(ContactAgainstKkt, InteriorLinesByASparseFactor) {
  double worst = 0;
  for (std::size_t rows : {8u, 21u}) {
    for (double nu : {0.3, 0.495}) {
      for (double contrast : {10.0, 100.0}) {
        for (std::size_t line : {std::size_t(1), rows / 3, rows - 3}) {
          worst = std::max(worst, worst_error(rows, nu, contrast, line, reference::KktMethod::kSparseFactor));
        }
      }
    }
  }
  printf("largest relative force error on interior lines: %.2e\n", worst);
}

// Dense elimination costs the cube of the unknowns: of the larger sizes it judges one material, the sparse
// factor the others.
TEST(ContactAgainstKkt, EverySizeMaterialAndKind) {
  double worst = 0;
  for (std::size_t rows : {8u, 11u, 16u, 21u}) {
    for (double nu : {0.3, 0.49, 0.495}) {
      for (double contrast : {1.0, 10.0, 100.0}) {
        const bool dense = rows <= 11 || (rows == 21 && nu == 0.495 && contrast == 100.0);
        worst = std::max(
            worst, worst_error(rows, nu, contrast, 0,
                               dense ? reference::KktMethod::kDense : reference::KktMethod::kSparseFactor));
      }
    }
  }
  printf("largest relative force error against the KKT reference: %.2e\n", worst);
}

// T6.3: 100 x 100 mm, 50 x 10 elements, 5 times stiffer at the bottom centre; one node pressed, free
// sideways.
TEST(PaperFig16, TouchingUnderTheSurfaceTable) {
  const std::array<double, 9> expected_49{1.191, 1.207, 1.207, 1.209, 1.219, 1.230, 1.256, 1.487, 2.763};
  const std::array<double, 9> expected_30{1.209, 1.256, 1.268, 1.271, 1.267, 1.257, 1.253, 1.340, 2.984};
  TissueGrid grid;
  grid.x_m = service::uniform_coordinates(0, 0.1, 50);
  grid.y_m = service::uniform_coordinates(0, 0.1, 10);
  const Fingertip node{.shape = FingertipShape::kNode};
  for (double nu : {0.49, 0.3}) {
    Material material{std::vector<double>(grid.elements(), 1e4), nu};
    for (std::size_t j : {8u, 9u}) {
      for (std::size_t i = 22; i < 28; ++i) material.youngs_modulus_pa[grid.element(i, j)] = 5e4;
    }
    TissueModel model(grid, material, {}, {});
    for (std::size_t line = 0; line < 9; ++line) {
      const auto stiffness = [&](std::size_t column) {
        const PlanePose pose{grid.x_m[column], 0.002};
        const auto answer =
            service::solve_contact(model.problem(), line, *model.compliance(line), node, pose);
        EXPECT_NEAR(answer.tangent_n_m[4], answer.force_n[1] / pose.indentation_m,
                    1e-9 * std::abs(answer.tangent_n_m[4]));
        return -answer.force_n[1] / pose.indentation_m;
      };
      const double contrast = stiffness(25) / stiffness(10),
                   expected = (nu == 0.49 ? expected_49 : expected_30)[line];
      EXPECT_NEAR(contrast, expected, 0.005 * expected) << "nu " << nu << " line " << 10 * line << " mm";
      EXPECT_NEAR(contrast, expected, 0.0006)
          << "nu " << nu << " line " << 10 * line << " mm";  // the printed digits
    }
  }
}

}  // namespace
}  // namespace teletact
