// What the chart holds the product to: ratios within one run. A figure that this run has no rival or no case
// for is left out.
#include <algorithm>
#include <cmath>
#include <limits>

#include "bench/suites/contact/contact.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// What the product solves with; other precisions are in the chart to compare.
bool is_product_pcg(const json& m) {
  return m.value("products_choice", false);
}
// "CG with the factor of a uniform modulus" is none: the making of its factor is not counted.
bool is_rival_cg(const json& m) {
  return m.at("method").get<std::string>().rfind("Eigen CG", 0) == 0 && m.at("goal_met").get<bool>();
}
bool is_factor(const json& m) {
  return m.contains("one_solve_s");
}
double p50(const json& m, const char* figure) {
  return m.at(figure).at("p50");
}

// Smallest figure among the methods that are meant; NaN for none.
double least(const json& of_case, auto&& meant, auto&& figure) {
  double smallest = kNan;
  for (const json& m : measured_methods(of_case))
    if (meant(m)) smallest = std::fmin(smallest, figure(m));  // fmin passes over NaN
  return smallest;
}

double least_pcg_s(const json& of_case) {
  return least(
      of_case, [](const json& m) { return is_product_pcg(m) && m.at("goal_met").get<bool>(); }, cold_s);
}

// Iterations of the product's PCG; NaN where it did not reach the goal.
double pcg_iterations(const json& of_case) {
  return least(
      of_case, [](const json& m) { return is_product_pcg(m) && m.at("goal_met").get<bool>(); },
      [](const json& m) { return m.at("iterations").get<double>(); });
}

double least_factor_and_solve_s(const json& of_case) {
  return least(of_case, is_factor, [](const json& m) { return p50(m, "setup_s") + p50(m, "one_solve_s"); });
}

std::vector<json> in_sweep(const json& result, const char* sweep) {
  std::vector<json> cases;
  for (const json& c : result.at("cases"))
    for (const json& name : c.at("sweeps"))
      if (name == sweep) cases.push_back(c);
  return cases;
}

bool is_square(const json& c) {
  return c.at("columns") == c.at("rows") && c.at("stretch") == 1.0;
}

void add_condensation(const json& base, const json& product, std::vector<Target>& targets) {
  const double factor_s = least(
      base, [](const json& m) { return m.contains("surface_s"); },
      [](const json& m) { return p50(m, "setup_s") + p50(m, "surface_s"); });
  for (const json& m : measured_methods(base)) {
    if (m.at("method") != "ours, condensed") continue;
    targets.push_back({"1. surface ready, over the best sparse factor with its surface solves",
                       p50(m, "setup_s") / factor_s, 1.0 / 6, ""});
    targets.push_back({"2. touch from the compliance, median", p50(m, "touch_s"), 8e-6, "s"});
    targets.push_back({"2. force error of that touch", m.at("force_error"), 1e-6, ""});
  }
  const json& lines = product.at("lines");
  targets.push_back({"1. all interior lines, over the surface alone",
                     p50(lines, "all_lines_s") / p50(lines, "surface_s") - 1, 3, ""});
  targets.push_back(
      {"1. strip of a 60 mm window ready, processor time", p50(product.at("strip"), "ready_s"), 0.025, "s"});
  const json& strip = product.at("strip");
  targets.push_back({"1. strip made again beside a changed neighbour, over made anew",
                     p50(strip, "refreshed_s") / p50(strip, "ready_s"), 2.0 / 3, ""});
  targets.push_back({"1. its difference from the one made anew", strip.at("refreshed_difference"), 0, ""});
  targets.push_back({"2. tangent against the slope of the force", product.at("tangent_error"), 1e-5, ""});
  targets.push_back(
      {"2. work around a closed loop, over the energy moved", product.at("loop_work"), 1e-6, ""});
  targets.push_back(
      {"2. stiffness ripple between nodes (tangent)", product.at("ripple").at("tangent"), 0.005, ""});
}

void add_speed(const json& result, const json& base, std::vector<Target>& targets) {
  const double pcg_s = least_pcg_s(base);
  targets.push_back(
      {"3. cold device PCG over Eigen's best CG, 61x61", pcg_s / least(base, is_rival_cg, cold_s), 0.1, ""});
  targets.push_back({"3. cold device PCG over the best sparse factor and solve, 61x61",
                     pcg_s / least_factor_and_solve_s(base), 1.0 / 3, ""});
  for (const json& c : in_sweep(result, "size"))
    if (c.at("columns") == 241)
      targets.push_back({"3. cold device PCG over the best sparse factor and solve, 241x241",
                         least_pcg_s(c) / least_factor_and_solve_s(c), 1.0 / 8, ""});
  const json& path = result.at("product").at("path");
  targets.push_back({"3. warm along a path, poses that solve (median), over cold",
                     p50(path, "solving_s") / pcg_s, 0.25, ""});
  targets.push_back({"3. warm along a path, mean of all poses, over cold",
                     path.at("warm_mean_s").get<double>() / pcg_s, 0.25, ""});
}

void add_iterations(const json& result, std::vector<Target>& targets) {
  double at_49 = 0, at_499 = 0, at_4999 = 0, failures = 0;
  for (const json& c : result.at("cases")) {
    const json& columns = c.at("by_columns");
    const double of_touch = pcg_iterations(c), nu = c.at("poisson_ratio"), contrast = c.at("contrast");
    if (std::isnan(of_touch) || !columns.at("converged").get<bool>() ||
        !(columns.at("force_error").get<double>() <= kForceGoal)) {
      ++failures;
      continue;
    }
    const double iterations = std::max(of_touch, columns.at("iterations").get<double>());
    if (nu <= 0.49 && contrast <= 10) at_49 = std::max(at_49, iterations);
    if (nu <= 0.499) at_499 = std::max(at_499, iterations);
    at_4999 = std::max(at_4999, iterations);
  }
  targets.push_back({"4. PCG iterations, nu <= .49, contrast <= 10, the most", at_49, 15, ""});
  targets.push_back({"4. PCG iterations, nu <= .499, contrast <= 1000, the most", at_499, 50, ""});
  targets.push_back({"4. PCG iterations, nu <= .4999, the most", at_4999, 100, ""});
  targets.push_back({"4. cases where the product's PCG does not reach the goal", failures, 0, ""});
}

void add_growth(const json& result, std::vector<Target>& targets) {
  std::vector<double> unknowns, seconds, iterations;
  for (const json& c : in_sweep(result, "size")) {
    if (!is_square(c) || c.at("columns") < 41) continue;
    unknowns.push_back(c.at("unknowns"));
    seconds.push_back(least_pcg_s(c));
    iterations.push_back(pcg_iterations(c));
  }
  if (unknowns.size() < 2) return;
  const bool all_reached =
      std::none_of(iterations.begin(), iterations.end(), [](double n) { return std::isnan(n); });
  const auto [fewest, most] = std::minmax_element(iterations.begin(), iterations.end());
  targets.push_back({"4. spread of the iterations over the grids, over the fewest",
                     all_reached ? (*most - *fewest) / *fewest : kNan, 0.2, ""});
  targets.push_back({"5. exponent of PCG's cost in unknowns", log_slope(unknowns, seconds), 1.1, ""});
}

}  // namespace

std::vector<Target> contact_targets(const json& result) {
  std::vector<Target> targets;
  const json base = in_sweep(result, "base").at(0);
  add_condensation(base, result.at("product"), targets);
  add_speed(result, base, targets);
  add_iterations(result, targets);
  add_growth(result, targets);
  return targets;
}

}  // namespace teletact::bench
