// How a touched layer gives way around the finger: of a plane as the reference's elasticity has it, of solid
// tissue as the whole block has it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "service/contact/plane_touch_model.h"
#include "service/contact/solid_contact.h"
#include "service/contact/solid_layer.h"
#include "tests/contact/exact_compliance.h"
#include "tests/solver/block_stencil.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

constexpr std::size_t kMany = 1000;

std::vector<double> evenly(double length_m, std::size_t n) {
  std::vector<double> out;
  for (std::size_t i = 0; i <= n; ++i)
    out.push_back(length_m * static_cast<double>(i) / static_cast<double>(n));
  return out;
}

TEST(DeformedLayer, OfAPlaneIsTheReferencesUnderTheContactsForces) {
  const TissueGrid grid{evenly(0.050, 50), evenly(0.030, 10)};
  Material material;
  material.poisson_ratio = 0.49;
  for (std::size_t j = 0; j < 10; ++j)
    for (std::size_t i = 0; i < 50; ++i)
      material.youngs_modulus_pa.push_back(i > 25 && i < 36 && j > 2 && j < 6 ? 40e3 : 10e3);
  tests::ExactCompliance exact(grid, material);
  TissueModelOptions options;
  options.touch_begin_m = 0.010, options.touch_end_m = 0.045;
  const PlaneTouchModel model(std::make_shared<TissueModel>(grid, material, Supports{}, options));
  const TouchWay by_gradients{.path = SolvePath::kGradients, .device = test_device()};
  for (const TouchWay& way : {TouchWay{}, by_gradients})
    for (const Friction friction : {Friction::kFrictionless, Friction::kStuck}) {
      const auto layer = model.layer({}, way, {});
      Fingertip tip;
      tip.friction = friction;
      const TouchPose pose{{0.0272, 0.003, 0}};
      if (const auto job = layer->wanted(tip, pose, 0)) job->work(TouchedLayer::Clock::time_point::max());
      const ContactAnswer answer = layer->answer(tip, pose);
      const auto deformed = layer->deformed(tip, pose, 0.012, kMany);
      ASSERT_TRUE(deformed);
      ASSERT_GE(deformed->x_m.size(), 20u);
      ASSERT_EQ(deformed->displacement_m.size(), deformed->x_m.size());
      double largest_m = 0;
      for (std::size_t a = 0; a < deformed->x_m.size(); ++a) {
        EXPECT_LE(std::abs(deformed->x_m[a] - 0.0272), 0.012);
        double want_m = 0;
        for (const NodalPressure& node : answer.pressure) {
          const auto at = [&](double x_m) { return static_cast<std::size_t>(std::lround(x_m / 0.001)); };
          const std::vector<std::size_t> nodes{at(deformed->x_m[a]), at(node.position_m[0])};
          const auto s = exact.among(nodes, nullptr);
          want_m += node.width_m[0] * (s(1, 3) * node.pressure_pa + s(1, 2) * node.traction_pa[0]);
        }
        EXPECT_NEAR(deformed->displacement_m[a], want_m, 2e-6) << deformed->x_m[a];
        largest_m = std::max(largest_m, want_m);
      }
      EXPECT_NEAR(largest_m, 0.003, 0.0003) << "about as deep as the tip";
      EXPECT_LE(layer->deformed(tip, pose, 0.012, 7)->x_m.size(), 7u) << "as many as are asked for";
      const auto above = layer->deformed(tip, {{0.0272, -0.001, 0}}, 0.012, kMany);
      ASSERT_TRUE(above);
      EXPECT_EQ(std::ranges::count(above->displacement_m, 0.0F),
                static_cast<std::ptrdiff_t>(above->x_m.size()));
    }
}

// A ball of five times the modulus below the surface: before a correction the surface is within 6 % of the
// largest displacement, after it within 0.5 %.
TEST(DeformedLayer, OfASolidIsTheBlocks) {
  const SolidGrid grid{32, 32, 0.002, 0.002, graded_rows(0.030, 12, 1.1)};
  const SolidTissue tissue = solid(grid, 0.49, [](double x, double y, double z) {
    return std::hypot(x - 0.032, y - 0.009, z - 0.034) < 0.006 ? 5e4 : 1e4;
  });
  const Queue queue = test_device()->queue();
  SolidContact<float> contact(queue, tissue);
  const Fingertip tip;
  const Vector3 pose{0.0323, 0.003, 0.0318};
  std::vector<std::size_t> nodes;
  for (std::size_t k = 8; k < 24; ++k)
    for (std::size_t i = 8; i < 24; ++i) nodes.push_back(i + grid.nx * k);
  const Eigen::VectorXd guessed = contact.moved_m(tip, pose, nodes);
  const ContactAnswer answer = contact.touch(tip, pose);
  ASSERT_TRUE(answer.solve.converged) << answer.solve.reason;
  const Eigen::VectorXd moved = contact.moved_m(tip, pose, nodes);
  // The whole block under the contact's forces; beyond the factor's layers, which alone are periodic there.
  SolidSolver<float> solver(queue, tissue);
  std::vector<std::size_t> unknowns;
  std::vector<double> force;
  for (const NodalPressure& node : answer.pressure) {
    const auto i = static_cast<std::size_t>(std::lround(node.position_m[0] / 0.002)),
               k = static_cast<std::size_t>(std::lround(node.position_m[2] / 0.002));
    unknowns.push_back(i + grid.nx * k + grid.columns());
    force.push_back(node.pressure_pa * 0.002 * 0.002);
  }
  const auto solved =
      solver.load(unknowns, Eigen::Map<Eigen::VectorXd>(force.data(), Eigen::Index(force.size())), {});
  ASSERT_LT(solved.relative_error(), 1e-2);
  const std::vector<float> u = solver.displacement();
  double largest_m = 0, worst_m = 0, worst_guess_m = 0;
  const auto periodic = solver.row()->layered;
  const auto wide = wide_surface(grid, solver.modulus()->layers, 0.49, choices::kMinPeriod * 0.030);
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    const std::size_t unknown = nodes[n] + grid.columns();
    double wider_m = 0;
    const Eigen::MatrixXd more = wide.between({unknown}, unknowns) -
                                 periodic.between({unknown}, unknowns);
    for (std::size_t f = 0; f < force.size(); ++f) wider_m += more(0, Eigen::Index(f)) * force[f];
    const double want_m = u[grid.columns() + nodes[n]] + wider_m;
    largest_m = std::max(largest_m, want_m);
    worst_m = std::max(worst_m, std::abs(moved[Eigen::Index(n)] - want_m));
    worst_guess_m = std::max(worst_guess_m, std::abs(guessed[Eigen::Index(n)] - want_m));
  }
  std::printf("largest %.3f mm; off by %.4f mm after corrections, %.4f mm before\n", 1e3 * largest_m,
              1e3 * worst_m, 1e3 * worst_guess_m);
  EXPECT_NEAR(largest_m, 0.003, 0.0005);
  EXPECT_LT(worst_m, 0.005 * largest_m);
  EXPECT_LT(worst_guess_m, 0.06 * largest_m);
}

}  // namespace
}  // namespace teletact::service
