// teletact-bench elastography: displacement, strain and modulus by every method on the phantoms of T2.7,
// error against time, and where each method fails.
#include <chrono>
#include <cstdio>
#include <memory>

#include "bench/suites/elastography/elastography.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

void warm(const std::vector<std::unique_ptr<Tracker>>& trackers) {  // a first launch compiles
  const Phantom p = Phantoms::uniform(-0.01, 0.005, 30, .99, 1);
  for (const auto& tracker : trackers)
    if (tracker->ours()) tracker->track(p.pre, p.post, p.geometry);
}

void print_lost(const json& rows) {
  for (const json& r : rows) {
    const json& c = r.at("case");
    std::printf(
        "no figure at the edge width compared at, a loss: %s, strain %g, %g dB, rho %g, contrast %g, "
        "%g mm (%d of %d seeds)\n",
        r.at("method").get<std::string>().c_str(), number(c.at("strain")), number(c.at("snr_db")),
        number(c.at("correlation")), number(c.at("contrast")), 1e3 * number(c.at("diameter_m")),
        r.at("seeds").get<int>(), r.at("of").get<int>());
  }
}

bool run(const SuiteOptions& options) {
  if (replotted(options, "elastography", draw_elastography)) return true;
  const auto device = service::Device::open();
  json result{{"suite", "elastography"},
              {"edge_m", kEdgeM},
              {"edge_rule",
               "SNRe and CNRe between the two kernels whose axial edge width brackets edge_m; a peer whose "
               "edge cannot be read has the middle's (edges_of_middle), which favours it; a method without a "
               "figure (without_figure) loses the point"},
              {"kernels_m", strain_kernels_m()},
              {"kernel_lateral_m", kKernelLateralM},
              {"device",
               {{"name", device->info().name},
                {"driver_version", device->info().driver_version},
                {"compute_units", device->info().compute_units}}},
              {"threads", "host methods on one thread, ours on the whole device"}};
  const auto trackers = make_trackers(device, TrackerOptions{}.max_strain);
  const auto wide = make_trackers(device, kWideStrain);
  warm(trackers);
  warm(wide);
  const auto timed = [&result](const char* part, auto&& measure) {
    const auto begin = std::chrono::steady_clock::now();
    result[part] = measure();
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    result["elapsed_s"][part] = seconds;
    std::printf("%s: %.0f s%40s\n", part, seconds, "");
  };
  json images;
  timed("rigid", [&] { return measure_rigid(trackers, options.quick); });
  timed("conditions", [&] { return measure_conditions(trackers, wide, options.quick, images); });
  result["images"] = std::move(images);
  result["failures"] = failures(result);
  result["without_figure"] = without_figure(result);
  timed("modulus", [&] { return measure_modulus(device, options.quick); });
  timed("stages", [&] { return measure_stages(device, options.quick); });
  print_stages(result["stages"]);
  print_lost(result["without_figure"]);
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
