// teletact-bench contact: the contact solve by every method on this machine, on the same problems, to the
// same error of the force (1e-6 of the double reference, T4.1).
#include "bench/suites/contact/contact.h"

#include <cstdio>
#include <memory>

#include "bench/run_suite.h"

namespace teletact::bench {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Rung, tolerance, seconds, iterations, force_error)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(MethodFigures, method, ours, iterative, products_choice, declined, failed,
                                   setup_s, touch_s, surface_s, one_solve_s, kept_bytes_per_unknown,
                                   tolerance, iterations, force_error, displacement_error, stated_error,
                                   goal_met, ladder)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ColumnFigures, failed, iterations, converged, stated_error, force_error)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(CaseFigures, sweeps, columns, rows, poisson_ratio, contrast, pattern,
                                   stretch, unknowns, contact_nodes, tip_radius_m, methods, by_columns)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LayerFigures, surface_s, all_layers_s)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(WindowTissueFigures, columns, rows, ready_s, refreshed_s,
                                   refreshed_difference)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Ripple, secant, tangent)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PathFigures, first_patch_s, warm_mean_s, warm_s, solving_s,
                                   largest_force_error)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ProductFigures, layers, window_tissue, tangent_error, loop_work, ripple,
                                   path)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(MeshFigures, columns, touched_nodes, ready_s, force_error,
                                   displacement_error)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ConvergenceFigures, pattern, contrast, finest_columns, meshes)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ContactFigures, force_goal, absent, device, threads, cases, product,
                                   convergence)

namespace {

void print(const MethodFigures& m) {
  if (!m.measured())
    std::printf("  %-34s %s%s\n", m.method.c_str(),
                m.declined.empty() ? "FAILED: " : "skipped: ", (m.declined + m.failed).c_str());
  else
    std::printf("  %-34s set-up %10.3f ms  touch %10.4f ms  %6zu iterations  force off by %.1e%s\n",
                m.method.c_str(), 1e3 * m.setup_s.p50, 1e3 * m.touch_s.p50, m.iterations, m.force_error,
                m.goal_met ? "" : "  (not to 1e-6)");
  std::fflush(stdout);
}

CaseFigures measure_case(const ChartCase& chart, const ContactProblem& problem, Peers& peers,
                         const std::shared_ptr<service::Device>& device, bool quick) {
  const ContactCase& c = chart.of;
  CaseFigures out{chart.sweeps,
                  c.columns,
                  c.rows,
                  c.poisson_ratio,
                  c.contrast,
                  to_string(c.pattern),
                  c.stretch,
                  problem.tissue.grid.dofs(),
                  problem.truth.columns.size(),
                  problem.tip.radius_m};
  std::printf("%s\n", describe(c).c_str());
  for (const auto& peer : peers.all) {
    if (chart.only_device_pcg && !(peer->ours() && peer->iterative())) continue;
    out.methods.push_back(measure_method(*peer, problem, chart.sweeps.front() == "base", quick));
    print(out.methods.back());
  }
  out.by_columns = measure_columns(problem, device);
  return out;
}

ContactFigures measure(const SuiteOptions& options, Promises& promises) {
  const bool quick = options.quick;
  const auto device = service::Device::open();
  Peers peers = make_peers(device);
  for (const std::string& absent : peers.absent) std::printf("skipped: %s\n", absent.c_str());
  ContactFigures figures{.absent = peers.absent, .device = describe(device->info())};
  for (const ChartCase& chart : chart_cases(quick)) {
    const ContactProblem problem = make_problem(chart.of);
    figures.cases.push_back(measure_case(chart, problem, peers, device, quick));
    if (chart.sweeps.front() == "base") figures.product = measure_product(problem, device, quick);
  }
  figures.convergence = measure_convergence(quick);
  add_contact_promises(figures, promises);
  return figures;
}

}  // namespace

void add_contact_suite(CLI::App& app, bool& met) {
  add_suite(app, "contact", "the contact solve by every method on this machine, ours and others'",
            std::make_shared<SuiteOptions>(), met, measure, draw_contact);
}

}  // namespace teletact::bench
