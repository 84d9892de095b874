// teletact-bench elastography: displacement, strain and modulus by every method on the phantoms of T2.7,
// error against time, and where each method fails.
#include "bench/suites/elastography/elastography.h"

#include <cstdio>
#include <memory>

#include "bench/basics/clock.h"

namespace teletact::bench {
namespace {

void warm(const Trackers& trackers) {  // a first launch compiles
  const Phantom p = Phantoms::uniform(-0.01, 0.005, 30, 0.99, 1);
  for (const auto* all : {&trackers.usual, &trackers.wide}) all->front().track(p.pre, p.post, p.geometry);
}

void print_lost(const std::vector<WithoutFigure>& rows) {
  for (const WithoutFigure& r : rows)
    std::printf(
        "no figure at the edge width compared at, a loss: %s, strain %g, %g dB, rho %g, contrast %g, %g mm "
        "(%zu of %zu seeds)\n",
        r.method.c_str(), r.of.strain, r.of.snr_db, r.of.correlation, r.of.contrast, 1e3 * r.of.diameter_m,
        r.seeds, r.of_seeds);
}

ElastographyFigures measure(const SuiteOptions& options, Promises& promises) {
  const bool quick = options.quick;
  const auto device = service::Device::open();
  ElastographyFigures figures{.device = describe(device->info())};
  const Trackers trackers = make_trackers(device);
  warm(trackers);
  const auto timed = [&figures](const char* part, auto&& work) {
    const double seconds = figures.elapsed_s[part] = seconds_of(work);
    std::printf("%s: %.0f s%40s\n", part, seconds, "");
  };
  timed("rigid", [&] { figures.rigid = measure_rigid(trackers, quick); });
  timed("conditions", [&] { figures.conditions = measure_conditions(trackers, quick, figures.images); });
  figures.failures = failures(figures.conditions);
  figures.without_figure = without_figure(figures.conditions);
  timed("modulus", [&] { figures.modulus = measure_modulus(device, quick); });
  timed("stages", [&] { figures.stages = measure_stages(device, quick); });
  for (const KernelProfile& profile : figures.stages.devices) print(profile);
  print_lost(figures.without_figure);
  add_elastography_promises(figures, promises);
  return figures;
}

}  // namespace

void add_elastography_suite(CLI::App& app, bool& met) {
  add_suite(app, "elastography",
            "displacement, strain and modulus by every method on phantoms: error against time",
            std::make_shared<SuiteOptions>(), met, measure, draw_elastography);
}

}  // namespace teletact::bench
