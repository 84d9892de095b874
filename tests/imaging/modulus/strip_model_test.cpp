#include "service/imaging/modulus/strip_model.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "service/tissue/elasticity_solver.h"
#include "tests/imaging/imaging_device.h"

namespace teletact::service {
namespace {

constexpr double kWidthM = 0.031;
const ImageGrid kGrid{61, 80, 0.3e-3, 0.2e-3, 0.5e-3, 0.49e-3};

double homogeneous_force(const TissueExtent& tissue, double width_m) {
  StripModel model(tissue, width_m);
  return model.solve(std::vector<double>(model.grid().elements(), 1.0)).force_n_per_m;
}

// nu = 0 and a window as wide as the tissue: plain compression, eps = -1 / depth, P = E width / depth.
TEST(StripModel, IsPlainCompressionWithoutPoissonEffect) {
  StripModel model({kWidthM, 0.040, 0, 0.0}, kWidthM);
  const StripResponse r = model.solve(std::vector<double>(model.grid().elements(), 3.0));
  EXPECT_NEAR(r.force_n_per_m, 3 * kWidthM / 0.040, 1e-9);
  for (const double stress : r.stress) EXPECT_NEAR(stress, -3 * 25, 1e-8);
}

TEST(StripModel, BondedBaseAndContextStiffen) {
  const double alone = homogeneous_force({0.060, 0.040, 0, 0.49}, 0.060);
  const double side = homogeneous_force({0.300, 0.040, 0, 0.49}, 0.060);
  const double inside = homogeneous_force({0.300, 0.040, 0.120, 0.49}, 0.060);
  EXPECT_GT(alone, 1.05 * 0.060 / 0.040);
  EXPECT_GT(side, 1.1 * alone);
  EXPECT_GT(inside, 1.1 * side);
}

// Against the device's conjugate gradients, with an inclusion: other assembly, other solver, other kind of
// reaction.
TEST(StripModel, AgreesWithTheElasticitySolver) {
  const TissueExtent tissue{0.070, 0.020, 0.020, 0.49};
  StripModel model(tissue, kWidthM);
  const TissueGrid& g = model.grid();
  Material material{std::vector<double>(g.elements(), 10e3), 0.49};
  for (std::size_t i = 20; i < 28; ++i)
    for (std::size_t j = 5; j < 12; ++j) material.youngs_modulus_pa[g.element(i, j)] = 50e3;
  ElasticitySolverOptions options;
  options.prescribed.assign(g.dofs(), 0);
  std::vector<double> push(g.dofs(), 0.0);
  for (std::size_t i = 0; i < g.nx(); ++i) {
    if (g.x_m[i] < -1e-9 || g.x_m[i] > kWidthM + 1e-9) continue;
    options.prescribed[2 * g.node(i, 0) + 1] = 1;
    push[2 * g.node(i, 0) + 1] = 1;
  }
  ElasticitySolver solver(imaging_device(), g, Supports{}, material, options);
  std::vector<double> u = push;
  ASSERT_TRUE(solver.solve(1, {}, u).converged);
  const std::vector<double> forces = solver.nodal_forces(1, u);
  double force = 0;
  for (std::size_t d = 0; d < g.dofs(); ++d) force += push[d] * forces[d];
  const StripResponse r = model.solve(material.youngs_modulus_pa);
  EXPECT_NEAR(r.force_n_per_m, force, 1e-5 * force);
  for (std::size_t j = 0; j + 1 < g.ny(); ++j)
    for (std::size_t i = 0; i + 1 < g.nx(); ++i) {
      const auto uy = [&](std::size_t a, std::size_t b) { return u[2 * g.node(i + a, j + b) + 1]; };
      const double strain = (uy(0, 1) + uy(1, 1) - uy(0, 0) - uy(1, 0)) / (2 * (g.y_m[j + 1] - g.y_m[j]));
      const double modulus = material.youngs_modulus_pa[g.element(i, j)];
      EXPECT_NEAR(r.stress[g.element(i, j)], modulus * strain, 1e-4 * 50 * modulus);
    }
}

TEST(StripModel, NothingIsSaidBelowTheTissue) {
  StripModel model({kWidthM, 0.020, 0, 0.49}, kWidthM);
  const Field field = model.on_image(std::vector<double>(model.grid().elements(), -1.0), kGrid);
  EXPECT_NEAR(field[61 * 30], -1, 1e-6);
  EXPECT_TRUE(std::isnan(field[61 * 60]));
}

TEST(StripModel, MapFillsHolesAndExtendsBesideTheWindow) {
  StripModel model({0.150, 0.040, 0.060, 0.49}, kWidthM);
  Field map(kGrid.size(), 10e3f);
  for (std::size_t n = 0; n < map.size(); ++n) {
    if (n % 61 < 12) map[n] = 40e3f;                       // the left 6 mm are stiff
    if (n / 61 < 8 || n % 7 == 0) map[n] = std::nanf("");  // near field and scattered holes
  }
  const TissueGrid& g = model.grid();
  const std::vector<double> e = model.on_elements(map, kGrid, 12e3);
  const std::vector<double> told =
      model.on_elements(map, kGrid, 12e3, {[](double x, double) {
                          return x < 0.040 ? 77e3 : x < 0.060 ? 20e3 : std::nan("");
                        }});
  for (std::size_t j = 0; j + 1 < g.ny(); ++j)
    for (std::size_t i = 0; i + 1 < g.nx(); ++i) {
      const double x = 0.5 * (g.x_m[i] + g.x_m[i + 1]), value = e[g.element(i, j)];
      if (x > 0 && x < 0.005) {
        EXPECT_NEAR(value, 40e3, 10) << x;
      }
      if (x > 0.008 && x < kWidthM) {
        EXPECT_NEAR(value, 10e3, 10) << x;
      }
      if (x < 0 && x > -0.004) {
        EXPECT_NEAR(value, 40e3, 10) << x;
      }
      if (x < -0.045) {
        EXPECT_NEAR(value, 12e3, 1e-6) << x;
      }
      if (x < 0) {  // scaled by 2 to meet at the border; geometric mean where the step lies inside
        const double width = g.x_m[i + 1] - g.x_m[i];
        const double beyond = std::clamp((-0.020 - g.x_m[i]) / width, 0.0, 1.0);
        const double sample = 1 / std::ceil(width / 1e-3), mean = 40e3 * std::pow(154.0 / 40, beyond);
        EXPECT_NEAR(told[g.element(i, j)], mean, beyond > 0 && beyond < 1 ? sample * mean : 10) << x;
      }
      if (x > 0) {
        EXPECT_EQ(told[g.element(i, j)], value) << x;
      }
    }
}

TEST(StripModel, RefusesAnExtentByItsField) {
  const auto refused = [](const TissueExtent& t, const char* field) {
    try {
      StripModel model(t, kWidthM);
    } catch (const std::invalid_argument& e) {
      return std::string(e.what()).find(field) != std::string::npos;
    }
    return false;
  };
  EXPECT_TRUE(refused({kWidthM, 0, 0, 0.49}, "depth_m"));
  EXPECT_TRUE(refused({kWidthM, 0.04, 0, 0.5}, "poisson_ratio"));
  EXPECT_TRUE(refused({kWidthM, 0.04, 0, std::nan("")}, "poisson_ratio"));
  EXPECT_TRUE(refused({kWidthM, 0.04, 0.001, 0.49}, "window_x_m"));
  EXPECT_TRUE(refused({kWidthM, 0.04, -0.001, 0.49}, "window_x_m"));
}

TEST(StripCache, TheSameGeometryIsSolvedOnce) {
  StripCache cache;
  const auto a = cache.get({0.300, 0.040, 0.090, 0.49}, kWidthM);
  EXPECT_EQ(a, cache.get({0.300, 0.040, 0.090, 0.49}, kWidthM));
  EXPECT_NE(a, cache.get({0.300, 0.040, 0, 0.49}, kWidthM));
  EXPECT_NE(a, cache.get({0.300, 0.041, 0.090, 0.49}, kWidthM));
}

}  // namespace
}  // namespace teletact::service
