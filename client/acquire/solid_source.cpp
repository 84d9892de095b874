#include "client/acquire/solid_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <thread>

#include "client/acquire/simulated_pair.h"
#include "client/patient/solid_press.h"

namespace teletact::client {

std::string slice_problem(const Tissue& tissue, const SlicePlaces& places) {
  if (!tissue.solid) return "solid: the tissue is the same for every z; add [solid] to the tissue file";
  if (places.count == 0) return "slices: give at least one";
  if (!(places.pitch_m > 0) || !std::isfinite(places.pitch_m))
    return fmt::format("slice_pitch_m: {} m; must be above 0", places.pitch_m);
  const double max_m = (tissue.solid->elevational_width_m - tissue.probe.elevation_m) / 2;
  const double first_m = places.first_z_m, last_m = places.z_m(places.count - 1);
  if (!(std::min(first_m, -last_m) >= -max_m - 1e-9 && std::max(-first_m, last_m) <= max_m + 1e-9))
    return fmt::format(
        "slices from z {:.4g} to {:.4g} m: the probe's face stays on the tissue from {:.4g} to {:.4g} m; "
        "take "
        "fewer, closer together, or a wider solid.elevational_width_m",
        first_m, last_m, -max_m, max_m);
  return "";
}

double slice_window_x_m(const Tissue& tissue) {
  return (tissue.width_m - tissue.probe.width_m) / 2;
}

SolidSource::SolidSource(const Tissue& tissue, const SlicePlaces& places, std::size_t passes,
                         const Progress& progress)
    : places_(places), compression_m_(tissue.probe.compression_m) {
  if (const std::string problem = slice_problem(tissue, places); !problem.empty()) throw TissueError(problem);
  const auto passes_of = [&](std::size_t k) {
    const ProbeState state =
        press_solid(tissue, slice_window_x_m(tissue), compression_m_, kSpacingM, places_.z_m(k));
    return simulated_pairs(tissue, state, k, passes);
  };
  const unsigned threads = std::clamp(std::thread::hardware_concurrency(), 1U, kMaxThreads);
  prepare(places.count, passes, progress, passes_of, threads);
}

}  // namespace teletact::client
