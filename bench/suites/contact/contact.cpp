// teletact-bench contact: the contact solve by every method on this machine, on the same problems, to the
// same error of the force (1e-6 of the double reference, T4.1).
#include <fmt/format.h>

#include <cstdio>
#include <exception>
#include <memory>

#include "bench/suites/contact/contact.h"

namespace teletact::bench {

namespace {

using nlohmann::json;

json measure_case(const ChartCase& chart, const ContactProblem& problem, Peers& peers,
                  const std::shared_ptr<service::Device>& device, bool quick) {
  const ContactCase& c = chart.of;
  json out{{"sweeps", chart.sweeps},
           {"columns", c.columns},
           {"rows", c.rows},
           {"poisson_ratio", c.poisson_ratio},
           {"contrast", c.contrast},
           {"pattern", to_string(c.pattern)},
           {"stretch", c.stretch},
           {"unknowns", problem.tissue.grid.dofs()},
           {"contact_nodes", problem.truth.columns.size()},
           {"tip_radius_m", problem.tip.radius_m},
           {"methods", json::array()}};
  std::printf("%s\n", describe(c).c_str());
  for (const auto& peer : peers.all) {
    if (chart.only_device_pcg && !(peer->ours() && peer->iterative())) continue;
    json method = measure_method(*peer, problem, chart.sweeps.front() == "base", quick);
    if (method.contains("declined")) {
      std::printf("  %-34s skipped: %s\n", peer->name().c_str(),
                  method["declined"].get<std::string>().c_str());
    } else if (method.contains("failed")) {
      std::printf("  %-34s FAILED: %s\n", peer->name().c_str(), method["failed"].get<std::string>().c_str());
    } else {
      std::printf("  %-34s set-up %10.3f ms  touch %10.4f ms  %6d iterations  force off by %.1e%s\n",
                  peer->name().c_str(), 1e3 * method["setup_s"]["p50"].get<double>(),
                  1e3 * method["touch_s"]["p50"].get<double>(), method["iterations"].get<int>(),
                  method["force_error"].is_null() ? -1 : method["force_error"].get<double>(),
                  method["goal_met"].get<bool>() ? "" : "  (not to 1e-6)");
    }
    std::fflush(stdout);
    out["methods"].push_back(std::move(method));
  }
  out["by_columns"] = measure_columns(problem, device);
  return out;
}

bool run(const SuiteOptions& options) {
  if (replotted(options, "contact", draw_contact)) return true;
  const auto device = service::Device::open();
  Peers peers = make_peers(device);
  for (const std::string& absent : peers.absent) std::printf("skipped: %s\n", absent.c_str());
  json result{{"suite", "contact"},
              {"force_goal", kForceGoal},
              {"absent", peers.absent},
              {"device",
               {{"name", device->info().name},
                {"driver_version", device->info().driver_version},
                {"compute_units", device->info().compute_units}}},
              {"threads", "host methods and their BLAS on one thread, device methods on the whole device"},
              {"cases", json::array()}};
  for (const ChartCase& chart : chart_cases(options.quick)) {
    const ContactProblem problem = make_problem(chart.of);
    result["cases"].push_back(measure_case(chart, problem, peers, device, options.quick));
    if (chart.sweeps.front() != "base") continue;
    result["product"] = measure_product(problem, device, options.quick);
    if (device->info().has_double)
      result["kernels"] = measure_kernels(problem, device->info().index, options.quick ? 20 : 100);
  }
  result["convergence"] = measure_convergence(options.quick);
  const bool met = finish(result, contact_targets(result), options);
  if (!options.out.empty()) draw_contact(result, options.out);
  return met;
}

}  // namespace

void add_contact_suite(CLI::App& app, bool& met) {
  const auto options = std::make_shared<SuiteOptions>();
  CLI::App& command =
      *app.add_subcommand("contact", "the contact solve by every method on this machine, ours and others'");
  add_common_options(command, *options);
  command.callback([options, &met] { met = run(*options); });
}

}  // namespace teletact::bench
