// The contact against what is known of the field under a tip: Hertz's pressure, the strain, the converged
// mesh.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numbers>
#include <vector>

#include "service/contact/contact.h"
#include "service/tissue/tissue_model.h"
#include "tests/reference/contact.h"
#include "tests/tissue/tissue_cases.h"

namespace teletact {
namespace {

using service::ContactAnswer;
using service::Fingertip;
using service::Material;
using service::TissueGrid;
using service::TissueModel;

ContactAnswer press(const TissueModel& model, const Fingertip& tip, double x_m, double indentation_m) {
  return service::solve_contact(model.problem(), 0, *model.compliance(0), tip, {x_m, indentation_m});
}

// A line load on a half plane spreads like Hertz says: contact half width a with p_max = E* a / 2R. A layer
// 10 a deep is close to it.
TEST(Contact, PressureIsHertzianInDeepTissue) {
  TissueGrid grid;
  grid.x_m = service::graded_coordinates(-0.1, 0.1, -0.006, 0.006, 2.5e-4, 0.005, 1.2);
  grid.y_m = service::graded_coordinates(0, 0.1, 0, 0.004, 2.5e-4, 0.005, 1.2);
  const double nu = 0.45;
  const TissueModel model(grid, {std::vector<double>(grid.elements(), 1e4), nu}, {}, {});
  const double radius = 0.02, modulus = 1e4 / (1 - nu * nu);
  const ContactAnswer answer = press(model, {.radius_m = radius}, 0, 0.002);
  // From the force: a^2 = 4 P' R / (pi E*), P' = F / thickness.
  const double line_load = -answer.force_n[1] / model.problem().thickness_m;
  const double half_width = std::sqrt(4 * line_load * radius / (std::numbers::pi * modulus));
  double peak = 0;
  for (const auto& p : answer.pressure) peak = std::max(peak, p.pressure_pa);
  EXPECT_NEAR(peak, modulus * half_width / (2 * radius), 0.02 * peak);
  // sqrt(1 - x^2 / a^2) falls to a fifth of the peak at x = .98 a; the rest is the skin's.
  double edge = 0;
  for (const auto& p : answer.pressure)
    if (p.pressure_pa > 0.2 * peak) edge = std::max(edge, p.position_m[0]);
  EXPECT_NEAR(edge, 0.98 * half_width, 3e-4);
}

// Largest principal strain at the element centres of a displacement field.
double peak_strain(const TissueGrid& grid, const Eigen::VectorXd& displacement) {
  double peak = 0;
  for (std::size_t j = 0; j + 1 < grid.ny(); ++j) {
    for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
      const auto u = [&](std::size_t a, std::size_t b) -> Eigen::Vector2d {
        return displacement.segment<2>(Eigen::Index(2 * grid.node(i + a, j + b)));
      };
      const Eigen::Vector2d by_x =
          (u(1, 0) + u(1, 1) - u(0, 0) - u(0, 1)) / (2 * (grid.x_m[i + 1] - grid.x_m[i]));
      const Eigen::Vector2d by_y =
          (u(0, 1) + u(1, 1) - u(0, 0) - u(1, 0)) / (2 * (grid.y_m[j + 1] - grid.y_m[j]));
      const double mean = (by_x[0] + by_y[1]) / 2;
      peak = std::max(peak, std::abs(mean) + std::hypot((by_x[0] - by_y[1]) / 2, (by_x[1] + by_y[0]) / 2));
    }
  }
  return peak;
}

TEST(Contact, LargestStrainIsThatOfTheField) {
  const TissueGrid grid = tests::uniform_grid(101, 41);
  const Material material = tests::inclusion(grid, 1, 0.49);
  const TissueModel model(grid, material, {}, {});
  for (double radius : {0.004, 0.008, 0.016}) {
    for (double d : {0.001, 0.002, 0.004}) {
      const Fingertip tip{.radius_m = radius};
      const auto field = reference::touch({grid, material, {}, 0, 0.01}, tip, {0.050, d},
                                          reference::KktMethod::kSparseFactor);
      EXPECT_NEAR(press(model, tip, 0.050, d).largest_strain / peak_strain(grid, field.displacement_m), 1,
                  0.2)
          << "radius " << radius << " indentation " << d;
    }
  }
}

TEST(Contact, StiffnessConvergesWithTheMesh) {
  std::vector<double> stiffness;
  for (std::size_t refine : {1u, 2u, 4u}) {
    const TissueGrid grid = tests::uniform_grid(40 * refine + 1, 20 * refine + 1, 2e-3 / double(refine));
    const TissueModel model(grid, tests::inclusion(grid, 1, 0.49), {}, {});
    stiffness.push_back(-press(model, {}, 0.0403, 0.004).force_n[1] / 0.004);
  }
  printf("rounded tip at 2, 1, 0.5 mm nodes: %.2f %.2f %.2f N/m\n", stiffness[0], stiffness[1], stiffness[2]);
  EXPECT_LE(std::abs(stiffness[2] - stiffness[1]), 0.5 * std::abs(stiffness[1] - stiffness[0]));
  EXPECT_LE(std::abs(stiffness[2] / stiffness[1] - 1), 0.01);
}

}  // namespace
}  // namespace teletact
