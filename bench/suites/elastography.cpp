// teletact-bench elastography: displacement, strain and modulus by every method on the phantoms of T2.7,
// error against time, and where each method fails.
#include <cstdio>
#include <fstream>
#include <memory>

#include "bench/suites/elastography.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

void warm(const std::vector<std::unique_ptr<Tracker>>& trackers) {  // a first launch compiles
  const Phantom p = Phantoms::uniform(-0.01, 0.005, 30, .99, 1);
  for (const auto& tracker : trackers)
    if (tracker->ours()) tracker->track(p.pre, p.post, p.geometry);
}

bool run(const SuiteOptions& options) {
  if (!options.replot.empty()) {
    if (options.out.empty()) throw BenchError("--replot needs --out");
    std::ifstream file(options.replot);
    if (!file) throw BenchError("cannot read --replot " + options.replot);
    draw_elastography(json::parse(file), options.out);
    return true;
  }
  const auto device = service::Device::open();
  json result{{"suite", "elastography"},
              {"quick", options.quick},
              {"edge_m", kEdgeM},
              {"kernels_m", strain_kernels_m()},
              {"kernel_lateral_m", kKernelLateralM},
              {"device",
               {{"name", device->info().name},
                {"driver_version", device->info().driver_version},
                {"compute_units", device->info().compute_units}}},
              {"threads", "host methods on one thread, ours on the whole device"}};
  const auto trackers = make_trackers(device);
  warm(trackers);
  result["rigid"] = measure_rigid(trackers, options.quick);
  result["conditions"] = measure_conditions(trackers, options.quick, result["images"]);
  result["failures"] = failures(result);
  result["modulus"] = measure_modulus(device, options.quick);
  result["stages"] = measure_stages(device, options.quick);
  print_stages(result["stages"]);
  const bool met = finish(result, elastography_targets(result), options);
  if (!options.out.empty()) draw_elastography(result, options.out);
  return met;
}

}  // namespace

void add_elastography_suite(CLI::App& app, bool& met) {
  const auto options = std::make_shared<SuiteOptions>();
  CLI::App& command = *app.add_subcommand(
      "elastography", "displacement, strain and modulus by every method on phantoms: error against time");
  add_common_options(command, *options);
  command.callback([options, &met] { met = run(*options); });
}

}  // namespace teletact::bench
