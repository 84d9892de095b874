// Nodal forces shared among taxels: nothing is lost, and nothing moves.
#include "service/contact/tactile_image.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace teletact::service {
namespace {

NodalPressure node(double x_m, double z_m, double force_n, double width_x_m = 0.001,
                   double width_z_m = 0.001) {
  NodalPressure out;
  out.position_m = {x_m, 0, z_m};
  out.width_m = {width_x_m, width_z_m};
  out.pressure_pa = force_n / (width_x_m * width_z_m);
  return out;
}

struct Moments {
  double force_n = 0, x_n_m = 0, z_n_m = 0, largest_n = 0;
};

Moments of(const std::vector<NodalPressure>& nodes, std::array<double, 2> centre_m) {
  Moments out;
  for (const NodalPressure& n : nodes) {
    const double f = n.pressure_pa * n.width_m[0] * n.width_m[1];
    out.force_n += f;
    out.x_n_m += f * (n.position_m[0] - centre_m[0]);
    out.z_n_m += f * (n.position_m[2] - centre_m[1]);
  }
  return out;
}

// Written beside the product: taxel (i, k) has its centre at (i + 1/2 - n/2) pitches.
Moments of(const Taxels& taxels, const TaxelGrid& grid) {
  Moments out{taxels.outside_n, taxels.outside_moment_n_m[0], taxels.outside_moment_n_m[1], 0};
  for (std::size_t k = 0; k < grid.along_z; ++k)
    for (std::size_t i = 0; i < grid.along_x; ++i) {
      const double f = taxels.pressure_pa[k * grid.along_x + i] * grid.pitch_m * grid.pitch_m;
      out.force_n += f;
      out.x_n_m += f * grid.pitch_m * (double(i) + 0.5 - double(grid.along_x) / 2);
      out.z_n_m += f * grid.pitch_m * (double(k) + 0.5 - double(grid.along_z) / 2);
      out.largest_n = std::max(out.largest_n, f);
    }
  return out;
}

std::vector<NodalPressure> scattered(double half_m, double width_x_m, double width_z_m) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> place(-half_m, half_m), force(0, 0.01);
  std::vector<NodalPressure> nodes;
  for (int n = 0; n < 200; ++n)
    nodes.push_back(node(0.03 + place(random), 0.02 + place(random), force(random), width_x_m, width_z_m));
  return nodes;
}

// Nodes finer than the taxels, as wide as they, coarser, and unlike along x and z (a plane's contact is 10 mm
// wide along z); all inside, and many of them beside the grid.
TEST(TactileImage, HasTheForceAndItsFirstMoments) {
  const std::array<double, 2> centre{0.03, 0.02};
  const TaxelGrid oblong{7, 12, 0.0015};
  for (const TaxelGrid& grid : {TaxelGrid{}, oblong})
    for (const auto& [wx, wz] : {std::pair{0.001, 0.001}, std::pair{0.002, 0.002}, std::pair{0.0035, 0.0025},
                                 std::pair{0.001, 0.010}})
      for (const double half : {0.001, 0.004, 0.012}) {
        const auto nodes = scattered(half, wx, wz);
        const Taxels taxels = share_among_taxels(nodes, grid, centre);
        const Moments nodal = of(nodes, centre), shown = of(taxels, grid);
        EXPECT_NEAR(taxels.force_n, nodal.force_n, 1e-10 * nodal.force_n);
        EXPECT_NEAR(shown.force_n, nodal.force_n, 1e-10 * nodal.force_n);
        EXPECT_NEAR(shown.x_n_m, nodal.x_n_m, 1e-10 * nodal.force_n * half);
        EXPECT_NEAR(shown.z_n_m, nodal.z_n_m, 1e-10 * nodal.force_n * half);
        EXPECT_GE(*std::min_element(taxels.pressure_pa.begin(), taxels.pressure_pa.end()), 0);
        if (half == 0.001 && wz < 0.010) {
          EXPECT_NEAR(taxels.outside_n, 0, 1e-14) << "all inside";
          for (const double moment_n_m : taxels.outside_moment_n_m)
            EXPECT_NEAR(moment_n_m, 0, 1e-10 * nodal.force_n * half) << "all inside";
        } else if (half == 0.012) {
          EXPECT_GT(taxels.outside_n, 0.1 * nodal.force_n) << "many are outside";
        }
      }
}

TEST(TactileImage, NodeOnAnEdgeIsSharedByTwoTaxels) {
  const TaxelGrid grid;  // 8 x 8 at 2 mm: edges at even millimetres from the centre
  const Taxels centre = share_among_taxels(std::vector{node(0.003, -0.005, 1)}, grid, {0, 0});
  EXPECT_NEAR(centre.pressure_pa[1 * 8 + 5], 1 / 4e-6, 1e-3);
  EXPECT_NEAR(of(centre, grid).largest_n, 1, 1e-12);
  const Taxels edge = share_among_taxels(std::vector{node(0.004, -0.005, 1)}, grid, {0, 0});
  EXPECT_NEAR(edge.pressure_pa[1 * 8 + 5], 0.5 / 4e-6, 1e-3);
  EXPECT_NEAR(edge.pressure_pa[1 * 8 + 6], 0.5 / 4e-6, 1e-3);
  const Taxels corner = share_among_taxels(std::vector{node(0, 0, 1)}, grid, {0, 0});
  for (const std::size_t at : {3 * 8 + 3, 3 * 8 + 4, 4 * 8 + 3, 4 * 8 + 4})
    EXPECT_NEAR(corner.pressure_pa[at], 0.25 / 4e-6, 1e-3);
}

TEST(TactileImage, WhatFallsBesideTheGridIsStatedAndNotMoved) {
  const TaxelGrid grid;
  const Taxels far = share_among_taxels(std::vector{node(0.012, 0.001, 0.3)}, grid, {0, 0});
  EXPECT_EQ(of(far, grid).largest_n, 0);
  EXPECT_DOUBLE_EQ(far.outside_n, 0.3);
  EXPECT_DOUBLE_EQ(far.outside_moment_n_m[0], 0.3 * 0.012);
  EXPECT_DOUBLE_EQ(far.outside_moment_n_m[1], 0.3 * 0.001);
  const Taxels border = share_among_taxels(std::vector{node(0.008, 0.001, 0.3)}, grid, {0, 0});
  EXPECT_NEAR(border.outside_n, 0.15, 1e-12) << "the half of it that lies outside";
  EXPECT_NEAR(border.pressure_pa[4 * 8 + 7], 0.15 / 4e-6, 1e-3);
}

TEST(TactileImage, OfNothingItIsZeros) {
  const Taxels none = share_among_taxels({}, {3, 5, 0.002}, {0, 0});
  EXPECT_EQ(none.pressure_pa, std::vector<double>(15, 0.0));
  EXPECT_EQ(none.outside_n, 0);
}

}  // namespace
}  // namespace teletact::service
