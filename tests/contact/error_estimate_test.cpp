// What answers state as their error against their true one (T4.2, T4.7): the same contact over a compliance
// that was computed in long double, element matrices included.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <vector>

#include "service/contact/contact.h"
#include "service/tissue/elasticity_solver.h"
#include "service/tissue/tissue_model.h"
#include "tests/contact/exact_compliance.h"
#include "tests/contact/iterative_with.h"
#include "tests/tissue/tissue_cases.h"

namespace teletact {
namespace {

using service::Compliance;
using service::Fingertip;
using service::Friction;
using service::Material;
using service::PlanePose;
using service::SolvePrecision;
using service::TissueGrid;
using service::TissueModel;
using tests::ExactCompliance;

struct Tissue {
  TissueGrid grid;
  Material material;
  double contrast;
  std::shared_ptr<ExactCompliance> exact;
};

std::vector<Tissue> make_tissues(const std::vector<TissueGrid>& grids, const std::vector<double>& contrasts) {
  std::vector<Tissue> all;
  for (const TissueGrid& grid : grids)
    for (const double nu : {0.3, 0.49, 0.499, 0.4999})
      for (const double contrast : contrasts) {
        const auto add = [&](Material material) {
          auto exact = std::make_shared<ExactCompliance>(grid, material);
          all.push_back({grid, std::move(material), contrast, std::move(exact)});
        };
        add(tests::inclusion(grid, contrast, nu));
        if (contrast > 1) add(tests::scattered(grid, contrast, nu));
      }
  return all;
}

// Made once: long double takes its time.
const std::vector<Tissue>& tissues() {
  static const std::vector<Tissue> all =
      make_tissues({tests::uniform_grid(31, 16), tests::uneven_grid(36, 19)}, {1, 10, 1e3, 1e6});
  return all;
}

// True error over the stated one, of touches all along the surface; returns the largest true one.
double add_touches(const TissueModel& model, Compliance& exact, Compliance& tried,
                   std::vector<double>& ratios) {
  double largest = 0;
  const auto& x = model.problem().grid.x_m;
  for (const double share : {0.22, 0.31, 0.4, 0.5, 0.63, 0.72})
    for (const Friction friction : {Friction::kFrictionless, Friction::kStuck}) {
      const Fingertip tip{.friction = friction};
      const PlanePose pose{x.front() + share * (x.back() - x.front()), 0.001};
      const auto answer = service::solve_contact(model.problem(), 0, tried, tip, pose);
      const auto truth = service::solve_contact(model.problem(), 0, exact, tip, pose).force_n;
      const double error = std::hypot(answer.force_n[0] - truth[0], answer.force_n[1] - truth[1]) /
                           std::hypot(truth[0], truth[1]);
      ratios.push_back(error / answer.solve.relative_error);
      largest = std::fmax(largest, std::isnan(error) ? INFINITY : error);
    }
  return largest;
}

// Prints what the estimates are worth; returns how many times too large they are in the median.
double judge(const char* what, std::vector<double> ratios) {
  EXPECT_TRUE(std::none_of(ratios.begin(), ratios.end(), [](double r) { return std::isnan(r); })) << what;
  std::sort(ratios.begin(), ratios.end());
  const auto at = [&](double share) { return ratios[std::size_t(share * double(ratios.size() - 1))]; };
  const auto bounded = std::upper_bound(ratios.begin(), ratios.end(), 1.0) - ratios.begin();
  std::printf("%s: %zu touches, %.2f %% within what is stated, which is %.1f times the error in the median\n",
              what, ratios.size(), 100 * double(bounded) / double(ratios.size()), 1 / at(0.5));
  EXPECT_GE(double(bounded), 0.99 * double(ratios.size())) << what << ", 99 % at " << at(0.99);
  return 1 / at(0.5);
}

// A bound for any tissue: far from the error, and far below what anything else is off by.
TEST(ErrorEstimate, OfTheCondensedModelBoundsAndIsSmall) {
  std::vector<double> ratios;
  double max_stated = 0;
  for (const Tissue& t : tissues()) {
    const TissueModel model(t.grid, t.material, {}, {});
    add_touches(model, *t.exact, *model.compliance(0), ratios);
    if (t.contrast > 10 || t.material.poisson_ratio > 0.49) continue;
    const double middle_m = 0.5 * (t.grid.x_m.front() + t.grid.x_m.back());
    const auto answer =
        service::solve_contact(model.problem(), 0, *model.compliance(0), {}, {middle_m, 0.001});
    max_stated = std::max(max_stated, answer.solve.relative_error);
  }
  judge("condensed", ratios);
  std::printf("at most %.1e is stated to nu 0.49 and contrast 10\n", max_stated);
  EXPECT_LE(max_stated, 1e-7);
}

// Empty: what the product picks.
class PcgErrorEstimate : public testing::TestWithParam<std::optional<SolvePrecision>> {};

TEST_P(PcgErrorEstimate, BoundsAndIsClose) {
  const auto device = service::Device::open();
  if (GetParam() == SolvePrecision::kDouble && !device->info().has_double)
    GTEST_SKIP() << "device without double";
  service::ElasticitySolverOptions options;
  if (GetParam()) options.precision = *GetParam();
  double largest = 0;
  std::vector<double> ratios;
  for (const Tissue& t : tissues()) {
    if (t.contrast != 10 && t.contrast != 1e3) continue;
    const TissueModel model(t.grid, t.material, {}, {});
    const auto columns =
        GetParam() ? service::iterative_with(options, model, 0, device) : model.compliance(0, device);
    largest = std::max(largest, add_touches(model, *t.exact, *columns, ratios));
  }
  std::printf("largest error of a force: %.1e\n", largest);
  // Near nu = 1/2 too: the product with K rounds no change of volume apart.
  EXPECT_LE(largest, GetParam() == SolvePrecision::kFloat ? 1e-5 : GetParam() ? 1e-13 : 1e-6);
  EXPECT_LE(judge("conjugate gradients", ratios), 5);
}

// Ten to one, both ways.
TEST(ErrorEstimate, OfConjugateGradientsBoundsOnStretchedElements) {
  const auto device = service::Device::open();
  if (!device->info().has_double) GTEST_SKIP() << "device without double";
  const TissueGrid flat{service::uniform_coordinates(0, 0.3, 30), service::uniform_coordinates(0, 0.01, 10)};
  const TissueGrid tall{service::uniform_coordinates(0, 0.04, 40), service::uniform_coordinates(0, 0.05, 5)};
  std::vector<double> ratios;
  for (const Tissue& t : make_tissues({flat, tall}, {10, 1e3})) {
    const TissueModel model(t.grid, t.material, {}, {});
    add_touches(model, *t.exact, *model.compliance(0, device), ratios);
  }
  EXPECT_LE(judge("conjugate gradients, stretched", ratios), 5);
}

INSTANTIATE_TEST_SUITE_P(Contact, PcgErrorEstimate,
                         testing::Values(SolvePrecision::kFloat, SolvePrecision::kDouble,
                                         SolvePrecision::kRefined, std::nullopt),
                         [](const auto& instance) {
                           return std::string(!instance.param                             ? "Product"
                                              : instance.param == SolvePrecision::kFloat  ? "Float"
                                              : instance.param == SolvePrecision::kDouble ? "Double"
                                                                                          : "Refined");
                         });

}  // namespace
}  // namespace teletact
