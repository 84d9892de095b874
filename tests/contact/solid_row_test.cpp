// Solid tissue touched on a row of nodes below its surface: against a sparse factor and the plane model, its
// derivatives, and what it states that it is off by.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <vector>

#include "service/contact/fingertip.h"
#include "service/contact/solid_contact.h"
#include "service/tissue/tissue_model.h"
#include "tests/reference/solid.h"
#include "tests/solver/block_stencil.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

constexpr double kMiddle = 0.032;
constexpr Fingertip kRound{};
constexpr Fingertip kStuckRound{.friction = Friction::kStuck};
constexpr Fingertip kFoot{.shape = FingertipShape::kNode, .footprint_m = 0.002};

Queue queue() {
  return test_device()->queue();
}
bool has_double() {
  return queue().supports(Precision::kDouble);
}

// A ball of contrast 10, which row kRow of nodes goes through.
constexpr std::size_t kRow = 5;
SolidTissue with_ball() {
  return solid({32, 32, 0.002, 0.002, graded_rows(0.040, 12, 1.06)}, 0.49, [](double x, double y, double z) {
    return std::hypot(x - kMiddle, y - 0.016, z - kMiddle) < 0.008 ? 1e5 : 1e4;
  });
}

// One element along z is plane strain, below the surface, too. So long a block that neither its period nor
// the plane's ends are felt.
TEST(SolidRow, OneElementAlongZIsThePlaneModels) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  constexpr std::size_t kColumns = 256;
  const SolidGrid grid{kColumns, 1, 0.002, 0.002, graded_rows(0.020, 8, 1.1)};
  const double middle_m = 0.001 * double(kColumns);
  const SolidTissue tissue = solid(grid, 0.49, [&](double x, double y, double) {
    return std::hypot(x - middle_m, y - 0.008) < 0.005 ? 1e5 : y < 0.004 ? 2e4 : 1e4;
  });
  TissueGrid plane_grid{{}, grid.y_m};
  for (std::size_t i = 0; i <= kColumns; ++i) plane_grid.x_m.push_back(0.002 * double(i));
  const TissueModel plane(
      plane_grid, Material{tissue.youngs_modulus_pa, 0.49}, Supports{},
      TissueModelOptions{.touch_begin_m = middle_m - 0.02, .touch_end_m = middle_m + 0.02});
  SolidSolver<double> solver(queue(), tissue);
  std::vector<std::size_t> nodes, unknowns;
  for (std::size_t i = kColumns / 2 - 6; i <= kColumns / 2 + 6; i += 3) {
    nodes.push_back(i);
    for (const std::size_t c : {0U, 1U}) unknowns.push_back(i + c * kColumns);
  }
  for (const std::size_t row : {0U, 3U, 7U}) {
    solver.at(std::make_shared<const SolidRow>(
        SolidRow{row, wide_surface(grid, solver.layers(), 0.49, 0, 0, row)}));
    const Eigen::MatrixXd c = plane.compliance(row)->among(nodes, nullptr) / grid.spacing_z_m;
    for (Eigen::Index q = 0; q < c.cols(); ++q) {
      const SolidSolution s = solver.load(unknowns, Eigen::VectorXd::Unit(c.cols(), q),
                                          {.relative_error = 1e-10, .max_iterations = 1000});
      EXPECT_EQ(s.reason, StopReason::kConverged);
      for (Eigen::Index p = 0; p < c.rows(); ++p)
        EXPECT_NEAR(s.displacement_m[p], c(p, q), 1e-7 * std::sqrt(c(p, p) * c(q, q))) << "row " << row;
    }
  }
}

// With the sparse factor's compliance every node is where its pressure says that it is.
TEST(SolidRow, TheTissueIsWhereTheSparseFactorPutsIt) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const SolidTissue tissue = lump_in_waves();
  const SolidGrid& grid = tissue.grid;
  const Vector3 pose{0.0312, 0.0018, 0.0193};
  const double area = grid.spacing_x_m * grid.spacing_z_m;
  const LayeredTissue layers = layered(tissue);
  const reference::SolidReference truth(tissue);
  SolidContact<double> surface(queue(), tissue);
  for (const std::size_t row : {1U, 2U, 4U}) {
    SolidContact<double> contact(surface, row);
    const SurfaceCompliance wide = wide_surface(grid, layers, 0.49, choices::kMinPeriod * 0.020, 0, row);
    const SurfaceCompliance periodic = wide_surface(grid, layers, 0.49, 0, 0, row);
    const ContactAnswer answer = contact.touch(kRound, pose, {.force_error = 1e-7});
    EXPECT_TRUE(answer.solve.converged) << "row " << row << ": " << answer.solve.relative_error;
    EXPECT_GT(contact.corrections(), 0u);
    std::vector<std::size_t> nodes, in_field;
    Eigen::VectorXd p(Eigen::Index(answer.pressure.size()));
    for (const NodalPressure& node : answer.pressure) {
      EXPECT_DOUBLE_EQ(node.position_m[1], grid.y_m[row]);
      const auto i = std::size_t(std::lround(node.position_m[0] / grid.spacing_x_m));
      const auto k = std::size_t(std::lround(node.position_m[2] / grid.spacing_z_m));
      p[Eigen::Index(nodes.size())] = node.pressure_pa * area;
      nodes.push_back(reference::unknown(grid, i, 0, k, 1));
      in_field.push_back(reference::unknown(grid, i, row, k, 1));
    }
    const Eigen::VectorXd moved =
        (truth.compliance(in_field) + wide.among(nodes) - periodic.among(nodes)) * p;
    const SkinThickness skin = skin_thickness(kRound, pose[1], std::sqrt(area));
    for (std::size_t n = 0; n < nodes.size(); ++n) {
      const Vector3& at = answer.pressure[n].position_m;
      const double r = std::hypot(at[0] - pose[0], at[2] - pose[2]);
      const SkinState state = skin_state(p[Eigen::Index(n)], kSkinStiffness / wide(1, 1, 0, 0), skin.t_m);
      EXPECT_NEAR(moved[Eigen::Index(n)], pose[1] - r * r / (2 * kRound.radius_m) + state.gap_m,
                  1e-6 * pose[1])
          << "row " << row << ", node " << n;
    }
  }
}

TEST(SolidRow, ForceAndTangentAreTheEnergysDerivatives) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  SolidContact<double> surface(queue(), with_ball()), contact(surface, kRow);
  const SolidContactOptions exact{.force_error = 1e-7};
  const Vector3 pose{kMiddle + 0.0063, 0.0021, kMiddle - 0.0037};
  for (const Fingertip& tip : {kRound, kStuckRound, kFoot}) {
    const ContactAnswer answer = contact.touch(tip, pose, exact);
    ASSERT_TRUE(answer.solve.converged) << answer.solve.reason;
    const double size = std::abs(answer.force_n[1]), stiff = std::abs(answer.tangent_n_m[4]);
    EXPECT_GT(std::abs(answer.force_n[0]), 0.01 * size) << "the ball pushes sideways";
    for (std::size_t c = 0; c < 3; ++c) {
      constexpr double kStep = 2e-5;
      Vector3 after = pose, before = pose;
      after[c] += kStep;
      before[c] -= kStep;
      const ContactAnswer a = contact.touch(tip, after, exact), b = contact.touch(tip, before, exact);
      EXPECT_NEAR(answer.force_n[c], -(a.energy_j - b.energy_j) / (2 * kStep), 1e-3 * size);
      for (std::size_t d = 0; d < 3; ++d)
        EXPECT_NEAR(answer.tangent_n_m[3 * d + c], (a.force_n[d] - b.force_n[d]) / (2 * kStep), 0.02 * stiff)
            << "dF" << d << "/d" << c;
    }
  }
}

// Homogeneous tissue is the same everywhere along x and z, pushes nowhere sideways, and is felt stiffer the
// more of it lies above.
TEST(SolidRow, HomogeneousTissuePushesStraightBack) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const SolidTissue tissue = solid({32, 32, 0.002, 0.002, graded_rows(0.040, 12, 1.06)}, 0.49,
                                   [](double, double, double) { return 1e4; });
  SolidContact<double> surface(queue(), tissue);
  double above = -surface.touch(kRound, {kMiddle, 0.002, kMiddle}).force_n[1];
  for (const std::size_t row : {1U, 3U, 6U}) {
    SolidContact<double> contact(surface, row);
    const Vector3 f = contact.touch(kRound, {kMiddle, 0.002, kMiddle}).force_n;
    EXPECT_GT(-f[1], 1.02 * above) << row;
    EXPECT_NEAR(f[0], 0, 1e-9 * above);
    EXPECT_NEAR(f[2], 0, 1e-9 * above);
    const Vector3 away = contact.touch(kRound, {kMiddle - 0.01, 0.002, kMiddle + 0.004}).force_n;
    EXPECT_NEAR(away[1], f[1], 1e-9 * above) << "five and two nodes away";
    EXPECT_EQ(contact.corrections(), 0u) << "layered tissue needs none";
    above = -f[1];
  }
}

// A finger travels through the ball's plane. In float, as it is asked to be corrected.
TEST(SolidRow, StatesWhatItIsOffByThroughALump) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const SolidTissue tissue = with_ball();
  SolidContact<double> exact_surface(queue(), tissue), exact(exact_surface, kRow);
  SolidContact<float> surface(queue(), tissue), contact(surface, kRow);
  std::size_t touches = 0, covered = 0;
  for (double x = -0.016; x < 0.016; x += 0.0013, ++touches) {
    const Vector3 pose{kMiddle + x, 0.0015 + 0.0005 * std::sin(300 * x), kMiddle + 0.003 * std::sin(200 * x)};
    const ContactAnswer a = contact.touch(kRound, pose, {.force_error = choices::kSolidForceError});
    const ContactAnswer b = exact.touch(kRound, pose, {.force_error = 1e-6});
    EXPECT_TRUE(a.solve.converged) << x << ": " << a.solve.reason << ", " << a.solve.relative_error;
    EXPECT_TRUE(b.solve.converged) << x << ": " << b.solve.reason << ", " << b.solve.relative_error;
    const Eigen::Vector3d f(a.force_n.data()), truth(b.force_n.data());
    const double error = (f - truth).norm() / truth.norm();
    covered += error <= a.solve.relative_error;
  }
  EXPECT_GE(covered, touches - touches / 10);
  EXPECT_LT(contact.corrections(), 2 * touches);
  std::printf("%zu touches: %zu corrections in float, %zu to 1e-6 in double, %zu covered\n", touches,
              contact.corrections(), exact.corrections(), covered);
}

TEST(SolidRow, IsTouchedWithinTheTissueBelowIt) {
  SolidContact<float> surface(queue(), with_ball()), contact(surface, kRow);
  const double below_m = 0.040 - contact.tissue().grid.y_m[kRow];
  EXPECT_THROW(contact.touch(kRound, {kMiddle, below_m, kMiddle}), std::invalid_argument);
  EXPECT_EQ(contact.touch(kRound, {kMiddle, 0, kMiddle}).state, ContactState::kNoContact);
}

}  // namespace
}  // namespace teletact::service
