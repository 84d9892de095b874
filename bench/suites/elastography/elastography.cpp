// teletact-bench elastography: displacement, strain and modulus by every method on the phantoms of T2.7,
// error against time, and where each method fails.
#include "bench/suites/elastography/elastography.h"

#include <cstdio>
#include <memory>

#include "bench/basics/clock.h"
#include "bench/run_suite.h"

namespace teletact::service {
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ImageGrid, nx, ny, origin_x_m, origin_y_m, dx_m, dy_m)
}  // namespace teletact::service

namespace teletact::bench {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PhantomCase, strain, snr_db, correlation, contrast, diameter_m,
                                   tissue_width_m)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(TrackErrors, axial_rmse_m, axial_p95_m, axial_max_m, lateral_rmse_m,
                                   valid_fraction, bias_m, hop_fraction)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(StrainQuality, snre, cnre, rmse, bias)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(EdgeWidth, axial_m, lateral_m)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ModulusQuality, contrast, dice, background, valid_fraction)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(SeedFigures, seconds, processor_s, errors, strain)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(TrackerFigures, method, ours, edges, edges_of_middle, seeds)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Spread, seeds, rms, low, high)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(CalibrationFigures, inside, outside)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Condition, of, factors, max_strain, peers_max_strain, bound_m,
                                   window_bound_m, filter_snre, companded_filter_snre, calibration, methods)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(NamedImage, title, values)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(StrainImages, grid, kernel_m, strain)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RigidPhase, shift_m, rmse_m, bias_m)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RigidMethod, method, ours, phases)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RigidFigures, bound_m, independent_lines, methods)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ModulusSeed, failed, seconds, displacement_s, strain_s, quality)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ModulusMethodFigures, method, ours, seeds, image)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ModulusCase, contrast, diameter_m, methods)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ModulusFigures, background_pa, judged, cases)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(WindowTimes, windows_s, displacement_s, strain_s, modulus_s, total_s,
                                   touch_latency_s)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(StageFigures, direct, iterative)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Failure, method, of, why)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(WithoutFigure, method, of, seeds, of_seeds)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ElastographyFigures, edge_m, edge_rule, kernels_m, kernel_lateral_m,
                                   device, threads, rigid, conditions, images, failures, without_figure,
                                   modulus, stages, elapsed_s)

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
