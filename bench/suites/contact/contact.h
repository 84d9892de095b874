// The parts of the contact chart (suite contact.cpp): what is run, measured, promised and drawn. All speak
// through the suite's JSON, so that targets and pictures can be made again from a file.
//
//   cases: [{sweeps, columns, rows, ..., unknowns, contact_nodes, methods: [{
//     method, ours, iterative, declined | failed | setup_s, touch_s: {p50, ...}, surface_s, one_solve_s,
//     kept_bytes_per_unknown, iterations, tolerance, force_error, displacement_error, stated_error, goal_met,
//     products_choice, ladder: [...]}]}]
//     by_columns: {iterations, converged, stated_error, force_error} of one touch as the product does it by
//     conjugate gradients: columns of the compliance, its own precision and tolerance
//   product: figures of ours alone
//   convergence: [{pattern, contrast, finest_columns, meshes: [{columns, force_error, displacement_error,
//   ...}]}]
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/peers/peer.h"
#include "bench/suite.h"

namespace teletact::bench {

constexpr double kForceGoal =
    1e-6;  // every method is timed at the loosest setting that gets the force so well

// A case and the charts that it belongs to: "base", "size", "poisson", "contrast", "pattern", "robustness".
struct ChartCase {
  ContactCase of;
  std::vector<std::string> sweeps;
  bool only_device_pcg = false;  // for its iterations
};
std::vector<ChartCase> chart_cases(bool quick);

// Checks, then times one method on one case.
nlohmann::json measure_method(Peer&, const ContactProblem&, bool whole_ladder, bool quick);

// One touch by the columns that the product solves for.
nlohmann::json measure_columns(const ContactProblem&, const std::shared_ptr<service::Device>&);

// Of the condensed touch: all lines, the scene's strip, tangent, work around a loop, ripple; of the device: a
// moving finger.
nlohmann::json measure_product(const ContactProblem& base, const std::shared_ptr<service::Device>&,
                               bool quick);

// One tip on finer and finer meshes: errors of force and displacement against a mesh twice as fine as the
// finest of them.
nlohmann::json measure_convergence(bool quick);

// Time of every kernel in a touch by conjugate gradients in double, the first one's set-up included, with its
// bytes and flops against what the device can do. Opens the device again, with profiling.
nlohmann::json measure_kernels(const ContactProblem&, std::size_t device_index, int touches);

// Acceptance lines that `result` holds figures for.
std::vector<Target> contact_targets(const nlohmann::json& result);

void draw_contact(const nlohmann::json& result, const std::string& folder);

// Methods of a case that were measured; and set-up and touch together, s.
std::vector<nlohmann::json> measured_methods(const nlohmann::json& of_case);
double cold_s(const nlohmann::json& method);
// Slope of log y over log x by least squares; NaN for fewer than two points.
double log_slope(const std::vector<double>& x, const std::vector<double>& y);

}  // namespace teletact::bench
