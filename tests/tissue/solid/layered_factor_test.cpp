// Layered tissue by transforms against a sparse factor.
#include "service/tissue/solid/layered_factor.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "service/tissue/solid/solid_tissue.h"
#include "service/tissue/solid/surface_compliance.h"
#include "tests/reference/solid.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

SolidTissue layers(const SolidGrid& grid, double nu) {
  return solid(grid, nu, [](double, double y, double) { return y < 0.006 ? 3e4 : y < 0.011 ? 1e4 : 5e4; });
}

TEST(LayeredFactor, TheSurfacesComplianceIsTheSparseFactors) {
  for (const std::size_t nz : {std::size_t{8}, std::size_t{1}}) {
    SolidGrid grid = small_grid();
    grid.nz = nz;
    const SolidTissue tissue = layers(grid, 0.49);
    const reference::SolidReference truth(tissue);
    const LayeredFactor f = factor(grid, layered(tissue), tissue.poisson_ratio, 16);
    const SurfaceCompliance table(grid.nx, grid.nz, f.inverse, f.pitch, grid.nx, grid.nz);
    for (std::size_t q = 0; q < 3; ++q) {
      Eigen::VectorXd load = Eigen::VectorXd::Zero(truth.stiffness().rows());
      load[Eigen::Index(reference::unknown(grid, 0, 0, 0, q))] = 1;
      const Eigen::VectorXd u = truth.solve(load);
      for (std::size_t p = 0; p < 3; ++p)
        for (long k = -long(nz / 2); k <= long(nz / 2); ++k)
          for (long i = -8; i <= 8; ++i) {
            const std::size_t at =
                reference::unknown(grid, std::size_t(i + 16), 0, std::size_t(k + long(nz)), p);
            EXPECT_NEAR(table(p, q, i, k), u[Eigen::Index(at)], 1e-11 * u.lpNorm<Eigen::Infinity>())
                << "from " << q << " to " << p << " at " << i << ", " << k;
          }
    }
    const std::vector<double> row = row_symbol(grid, layered(tissue), tissue.poisson_ratio, 16);
    ASSERT_EQ(row.size(), 6 * (nz / 2 + 1) * 16);
    const double largest = *std::max_element(row.begin(), row.end());
    for (std::size_t k = 0; k < row.size(); ++k)
      EXPECT_NEAR(row[k], f.inverse[k], 1e-14 * largest) << k;  // rounding
  }
}

TEST(LayeredFactor, ARowsComplianceIsTheSparseFactors) {
  const SolidGrid grid = small_grid();
  const SolidTissue tissue = layers(grid, 0.49);
  const reference::SolidReference truth(tissue);
  for (std::size_t row = 0; row < grid.layers(); ++row) {
    const SurfaceCompliance table = wide_surface(grid, layered(tissue), 0.49, 0, 0, row);
    for (std::size_t q = 0; q < 3; ++q) {
      Eigen::VectorXd load = Eigen::VectorXd::Zero(truth.stiffness().rows());
      load[Eigen::Index(reference::unknown(grid, 0, row, 0, q))] = 1;
      const Eigen::VectorXd u = truth.solve(load);
      for (std::size_t p = 0; p < 3; ++p)
        for (long k = -4; k <= 4; ++k)
          for (long i = -8; i <= 8; ++i)
            EXPECT_NEAR(
                table(p, q, i, k),
                u[Eigen::Index(reference::unknown(grid, std::size_t(i + 16), row, std::size_t(k + 8), p))],
                1e-11 * u.lpNorm<Eigen::Infinity>())
                << "row " << row << ", from " << q << " to " << p << " at " << i << ", " << k;
    }
  }
}

TEST(LayeredFactor, ComparesEachLayerWithItsGeometricMean) {
  SolidGrid grid = small_grid();
  SolidTissue tissue =
      solid(grid, 0.3, [](double x, double y, double) { return y < 0.01 ? (x < 0.016 ? 1e4 : 4e4) : 7e4; });
  const LayeredTissue mean = layered(tissue);
  EXPECT_NEAR(mean.youngs_modulus_pa.front(), 2e4, 1e-8);
  EXPECT_DOUBLE_EQ(mean.youngs_modulus_pa.back(), 7e4);
  EXPECT_NEAR(mean.least, 0.5, 1e-12);
  EXPECT_NEAR(mean.largest, 2, 1e-12);
}

TEST(Hexahedron, IsTheGaussQuadraturesAndRigidMotionsCostNothing) {
  SolidGrid grid{2, 2, 0.0013, 0.0021, {0, 0.0017, 0.0030}};
  const SolidTissue tissue = rough(grid, 0.4999, 10);
  const auto k = reference::assemble(tissue);
  // One element of two layers: the upper one's block of its own corners, summed over the period.
  const HexahedronMatrix unit = hexahedron_stiffness(0.0013, 0.0017, 0.0021, 0.4999);
  EXPECT_LT((unit - unit.transpose()).cwiseAbs().maxCoeff(), 1e-15 * unit.cwiseAbs().maxCoeff());
  for (int c = 0; c < 3; ++c) {
    Eigen::Matrix<double, 24, 1> move = Eigen::Matrix<double, 24, 1>::Zero();
    for (int corner = 0; corner < 8; ++corner) move[3 * corner + c] = 1;
    EXPECT_LT((unit * move).lpNorm<Eigen::Infinity>(), 1e-13 * unit.cwiseAbs().maxCoeff());
  }
  double diagonal = 0;  // of u_y at a surface node: the four elements below it, the same corner of each
  for (std::size_t e = 0; e < 4; ++e) diagonal += tissue.youngs_modulus_pa[e] * unit(1, 1);
  const auto at = Eigen::Index(reference::unknown(grid, 0, 0, 0, 1));
  EXPECT_NEAR(k.coeff(at, at), diagonal, 1e-12 * diagonal);
}

TEST(SolidTissue, RefusesWhatItCannotModelByField) {
  const SolidTissue good = rough(small_grid(), 0.49, 2);
  const auto refused = [](SolidTissue tissue, const char* field) {
    try {
      validate(tissue);
      ADD_FAILURE() << field << " was taken";
    } catch (const std::invalid_argument& e) {
      EXPECT_EQ(std::string(e.what()).rfind(field, 0), 0u) << e.what();
    }
  };
  validate(good);
  SolidTissue t = good;
  t.grid.nx = 12;
  refused(t, "nx");
  t = good;
  t.grid.nz = 0;
  refused(t, "nz");
  t = good;
  t.grid.spacing_z_m = 0;
  refused(t, "spacing_z_m");
  t = good;
  t.grid.y_m[2] = t.grid.y_m[1];
  refused(t, "y_m[2]");
  t = solid({16, 8, 0.002, 0.0025, {0, 0.002}, true}, 0.49, [](double, double, double) { return 1e4; });
  refused(t, "y_m");
  t = good;
  t.poisson_ratio = 0.5;
  refused(t, "poisson_ratio");
  t = good;
  t.youngs_modulus_pa[5] = NAN;
  refused(t, "youngs_modulus_pa[5]");
  t.youngs_modulus_pa.pop_back();
  refused(t, "youngs_modulus_pa has");
}

}  // namespace
}  // namespace teletact::service
