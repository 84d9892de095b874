// The bound that is stated for what rounding does to a condensed compliance, against measured rounding: the
// same tissue in other units rounds differently, and its compliance differs by factors alone.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

#include "service/tissue/elasticity_solver.h"
#include "service/tissue/tissue_model.h"
#include "tests/tissue/tissue_cases.h"

namespace teletact {
namespace {

using service::Material;
using service::TissueGrid;
using service::TissueModel;

struct Case {
  std::string name;
  TissueGrid grid;
  std::vector<std::size_t> rows;
  std::size_t max_compliance_bytes = std::size_t{256} << 20;  // small: interior rows column by column
};

// Columns 1 mm apart under the finger and up to 8 mm beside it, as the tissue of windows is.
TissueGrid window_tissue(std::size_t rows) {
  return {service::graded_coordinates(0, 0.26, 0.1, 0.16, 1e-3, 8e-3, 1.3),
          service::uniform_coordinates(0, 1e-3 * double(rows), rows)};
}

std::vector<Case> cases() {
  const TissueGrid flat{service::uniform_coordinates(0, 0.3, 30), service::uniform_coordinates(0, 0.01, 10)},
      tall{service::uniform_coordinates(0, 0.04, 40), service::uniform_coordinates(0, 0.05, 5)};
  return {{"21x11", tests::uniform_grid(21, 11), {0, 5, 9}},
          {"31x16, columns", tests::uniform_grid(31, 16), {0, 7, 14}, 1},
          {"36x19 uneven", tests::uneven_grid(36, 19), {0, 9, 17}},
          {"11x41 deep", tests::uniform_grid(11, 41), {0, 20, 39}},
          {"61x9 wide", tests::uniform_grid(61, 9), {0, 4}, 1},
          {"41x41", tests::uniform_grid(41, 41), {0}},
          {"flat elements", flat, {0, 5}},
          {"tall elements", tall, {0, 3}},
          {"31x81 deep", tests::uniform_grid(31, 81), {0, 40}},
          {"31x81 deep, columns", tests::uniform_grid(31, 81), {40}, 1},
          {"window", window_tissue(33), {0, 10}},
          {"window, columns", window_tissue(33), {10}, 1}};
}

TissueGrid in_units(TissueGrid grid, const service::Units& units) {
  for (double& x : grid.x_m) x *= units.length;
  for (double& y : grid.y_m) y *= units.length;
  return grid;
}

Material in_units(Material material, const service::Units& units) {
  for (double& e : material.youngs_modulus_pa) e *= units.modulus;
  return material;
}

Eigen::MatrixXd compliance(const TissueModel& model, std::size_t row, service::SolveReport* report) {
  std::vector<std::size_t> nodes(model.problem().grid.nx());
  std::iota(nodes.begin(), nodes.end(), 0);
  return model.compliance(row)->among(nodes, report);
}

// Largest |dC_ij| / sqrt(C_ii C_jj) between the tissue in two units.
double measured(const Case& c, const Material& material, std::size_t row, double* stated) {
  const TissueModel model(c.grid, material, {}, {.max_compliance_bytes = c.max_compliance_bytes});
  service::SolveReport report;
  const Eigen::MatrixXd here = compliance(model, row, &report);
  *stated = report.relative_error;
  const Eigen::VectorXd root = here.diagonal().cwiseSqrt();
  double largest = 0;
  for (std::size_t k = 0; k < 2; ++k) {
    const service::Units& units = service::kOtherUnits[k];
    const TissueModel other(in_units(c.grid, units), in_units(material, units), {},
                            {.max_compliance_bytes = c.max_compliance_bytes});
    const Eigen::MatrixXd difference = units.modulus * compliance(other, row, nullptr) - here;
    largest = std::max(largest, (difference.array() / (root * root.transpose()).array()).abs().maxCoeff());
  }
  return largest;
}

// What elimination refuses in double precision: tissue that is all but incompressible.
bool refused(const std::domain_error& error, double nu) {
  return nu > 0.4999 && std::string(error.what()).find("not positive definite") != std::string::npos;
}

void expect_bounded(const std::vector<Case>& tissues) {
  std::vector<double> ratios;
  const auto compare = [&ratios](const Case& c, const Material& material, std::size_t row) {
    double stated = 0;
    const double error = measured(c, material, row, &stated);
    EXPECT_LE(error, stated) << c.name << ", row " << row << ", nu " << material.poisson_ratio;
    ratios.push_back(stated / error);
  };
  for (const Case& c : tissues)
    for (const double nu : {0.0, 0.3, 0.49, 0.499, 0.4999, 0.499999})
      for (const double contrast : {1.0, 10.0, 1e3, 1e6})
        for (const bool scattered : {false, true})
          for (const std::size_t row : c.rows) try {
              compare(
                  c,
                  scattered ? tests::scattered(c.grid, contrast, nu) : tests::inclusion(c.grid, contrast, nu),
                  row);
            } catch (const std::domain_error& error) {
              EXPECT_TRUE(refused(error, nu))
                  << c.name << " " << nu << " " << contrast << ": " << error.what();
            }
  std::sort(ratios.begin(), ratios.end());
  std::printf("%zu rows: stated over measured, least %.1f, median %.0f, most %.0f\n", ratios.size(),
              ratios.front(), ratios[ratios.size() / 2], ratios.back());
  EXPECT_LE(ratios[ratios.size() / 2], 1000);
}

TEST(Rounding, IsBoundedByWhatIsStated) {
  expect_bounded(cases());
}

// The same of the deepest: the group sweeps.
TEST(Rounding, OfTissue121RowsDeepIsBounded) {
  expect_bounded({{"61x121 deep", tests::uniform_grid(61, 121), {0, 60}},
                  {"61x121 deep, columns", tests::uniform_grid(61, 121), {60}, 1}});
}

}  // namespace
}  // namespace teletact
