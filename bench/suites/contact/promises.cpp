// What the chart holds the product to: ratios within one run. A figure that this run has no rival or no case
// for is left out.
#include <algorithm>
#include <cmath>

#include "bench/basics/median.h"
#include "bench/suites/contact/contact.h"

namespace teletact::bench {
namespace {

// What the product solves with; other precisions are in the chart to compare.
bool is_product_pcg(const MethodFigures& m) {
  return m.products_choice && m.goal_met;
}
// "CG with the factor of a uniform modulus" is none: the making of its factor is not counted.
bool is_rival_cg(const MethodFigures& m) {
  return m.method.rfind("Eigen CG", 0) == 0 && m.goal_met;
}

// Smallest figure among the methods that are meant; NaN for none.
double least(const CaseFigures& c, auto&& meant, auto&& figure) {
  double smallest = kNan;
  for (const MethodFigures& m : c.methods)
    if (m.measured() && meant(m)) smallest = std::fmin(smallest, figure(m));  // fmin passes over NaN
  return smallest;
}

double cold_s(const MethodFigures& m) {
  return m.cold_s();
}
double min_pcg_s(const CaseFigures& c) {
  return least(c, is_product_pcg, cold_s);
}
// Iterations of the product's PCG; NaN where it did not reach the goal.
double pcg_iterations(const CaseFigures& c) {
  return least(c, is_product_pcg, [](const MethodFigures& m) { return static_cast<double>(m.iterations); });
}
double min_factor_and_solve_s(const CaseFigures& c) {
  return least(
      c, [](const MethodFigures& m) { return m.one_solve_s.count > 0; },
      [](const MethodFigures& m) { return m.setup_s.p50 + m.one_solve_s.p50; });
}

void add_condensation(const CaseFigures& base, const ProductFigures& product, Promises& promises) {
  const double factor_s = least(
      base, [](const MethodFigures& m) { return m.surface_s.count > 0; },
      [](const MethodFigures& m) { return m.setup_s.p50 + m.surface_s.p50; });
  for (const MethodFigures& m : base.methods) {
    if (!m.measured() || m.method != "ours, condensed") continue;
    promises.push_back(
        {"surface_ready_over_best_sparse_factor_with_surface_solves", m.setup_s.p50 / factor_s, 1.0 / 6});
    promises.push_back({"touch_from_compliance_p50", m.touch_s.p50, 8e-6, "s"});
    promises.push_back({"touch_from_compliance_force_error", m.force_error, 1e-6});
  }
  const LayerFigures& layers = product.layers;
  const WindowTissueFigures& window_tissue = product.window_tissue;
  promises.push_back(
      {"interior_layers_over_the_surface_alone", layers.all_layers_s.p50 / layers.surface_s.p50 - 1, 3});
  promises.push_back(
      {"window_tissue_of_60_mm_window_ready_processor_time", window_tissue.ready_s.p50, 0.025, "s"});
  promises.push_back({"window_tissue_beside_changed_neighbour_over_made_anew",
                      window_tissue.refreshed_s.p50 / window_tissue.ready_s.p50, 2.0 / 3});
  promises.push_back({"window_tissue_beside_changed_neighbour_difference_from_made_anew",
                      window_tissue.refreshed_difference, 0});
  promises.push_back({"tangent_off_the_slope_of_the_force", product.tangent_error, 1e-5});
  promises.push_back({"work_around_a_closed_loop_over_energy_moved", product.loop_work, 1e-6});
  promises.push_back({"stiffness_ripple_between_nodes_of_the_tangent", product.ripple.tangent, 0.005});
}

void add_speed(const ContactFigures& figures, const CaseFigures& base, Promises& promises) {
  const double pcg_s = min_pcg_s(base);
  promises.push_back(
      {"cold_device_pcg_over_best_eigen_cg_61x61", pcg_s / least(base, is_rival_cg, cold_s), 0.1});
  promises.push_back({"cold_device_pcg_over_best_sparse_factor_and_solve_61x61",
                      pcg_s / min_factor_and_solve_s(base), 1.0 / 3});
  for (const CaseFigures& c : figures.cases)
    if (c.in("size") && c.columns == 241)
      promises.push_back({"cold_device_pcg_over_best_sparse_factor_and_solve_241x241",
                          min_pcg_s(c) / min_factor_and_solve_s(c), 1.0 / 8});
  const PathFigures& path = figures.product.path;
  promises.push_back({"warm_along_a_path_solving_poses_p50_over_cold", path.solving_s.p50 / pcg_s, 0.25});
  promises.push_back({"warm_along_a_path_mean_of_all_poses_over_cold", path.warm_mean_s / pcg_s, 0.25});
}

void add_iterations(const ContactFigures& figures, Promises& promises) {
  double at_49 = 0, at_499 = 0, at_4999 = 0, failures = 0;
  for (const CaseFigures& c : figures.cases) {
    const double of_touch = pcg_iterations(c);
    if (std::isnan(of_touch) || !c.by_columns.converged || !(c.by_columns.force_error <= kForceGoal)) {
      ++failures;
      continue;
    }
    const double iterations = std::max(of_touch, static_cast<double>(c.by_columns.iterations));
    if (c.poisson_ratio <= 0.49 && c.contrast <= 10) at_49 = std::max(at_49, iterations);
    if (c.poisson_ratio <= 0.499) at_499 = std::max(at_499, iterations);
    at_4999 = std::max(at_4999, iterations);
  }
  promises.push_back({"max_pcg_iterations_to_poisson_ratio_0_49_and_contrast_10", at_49, 15});
  promises.push_back({"max_pcg_iterations_to_poisson_ratio_0_499_and_contrast_1000", at_499, 50});
  promises.push_back({"max_pcg_iterations_to_poisson_ratio_0_4999", at_4999, 100});
  promises.push_back({"cases_where_the_products_pcg_misses_the_goal", failures, 0});
}

void add_growth(const ContactFigures& figures, Promises& promises) {
  std::vector<double> unknowns, seconds, iterations;
  for (const CaseFigures& c : figures.cases) {
    if (!c.in("size") || c.columns != c.rows || c.stretch != 1 || c.columns < 41) continue;
    unknowns.push_back(static_cast<double>(c.unknowns));
    seconds.push_back(min_pcg_s(c));
    iterations.push_back(pcg_iterations(c));
  }
  if (unknowns.size() < 2) return;
  const bool all_reached =
      std::none_of(iterations.begin(), iterations.end(), [](double n) { return std::isnan(n); });
  const auto [fewest, most] = std::minmax_element(iterations.begin(), iterations.end());
  promises.push_back({"pcg_iterations_spread_over_grids_over_the_fewest",
                      all_reached ? (*most - *fewest) / *fewest : kNan, 0.2});
  promises.push_back({"pcg_cost_exponent_in_unknowns", log_slope(unknowns, seconds), 1.1});
}

}  // namespace

void add_contact_promises(const ContactFigures& figures, Promises& promises) {
  const auto found = std::find_if(figures.cases.begin(), figures.cases.end(),
                                  [](const CaseFigures& c) { return c.in("base"); });
  if (found == figures.cases.end()) throw BenchError("cases: none is the base");
  const CaseFigures& base = *found;
  add_condensation(base, figures.product, promises);
  add_speed(figures, base, promises);
  add_iterations(figures, promises);
  add_growth(figures, promises);
}

}  // namespace teletact::bench
