#include "client/acquire/solid_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <stdexcept>
#include <thread>

#include "client/acquire/simulated_pair.h"
#include "client/patient/parallel.h"
#include "client/patient/solid_press.h"

namespace teletact::client {

std::string slice_problem(const Tissue& tissue, const SlicePlaces& places) {
  if (!tissue.solid) return "solid: the tissue is the same for every z; add [solid] to the tissue file";
  if (places.count == 0) return "slices: give at least one";
  if (!(places.pitch_m > 0) || !std::isfinite(places.pitch_m))
    return fmt::format("slice_pitch_m: {} m; must be above 0", places.pitch_m);
  const double most_m = (tissue.solid->elevational_width_m - tissue.probe.elevation_m) / 2;
  const double first_m = places.first_z_m, last_m = places.z_m(places.count - 1);
  if (!(std::min(first_m, -last_m) >= -most_m - 1e-9 && std::max(-first_m, last_m) <= most_m + 1e-9))
    return fmt::format(
        "slices from z {:.4g} to {:.4g} m: the probe's face stays on the tissue from {:.4g} to {:.4g} m; "
        "take "
        "fewer, closer together, or a wider solid.elevational_width_m",
        first_m, last_m, -most_m, most_m);
  return "";
}

double slice_window_x_m(const Tissue& tissue) {
  return (tissue.width_m - tissue.probe.width_m) / 2;
}

SolidSource::SolidSource(const Tissue& tissue, const SlicePlaces& places, std::size_t passes,
                         unsigned threads, const Progress& progress)
    : places_(places), compression_m_(tissue.probe.compression_m), slices_(places.count) {
  if (const std::string problem = slice_problem(tissue, places); !problem.empty()) throw TissueError(problem);
  if (passes == 0) throw std::invalid_argument("at least one pass must be prepared");
  if (threads == 0) threads = std::max(1U, std::thread::hardware_concurrency());
  std::mutex mutex;  // guards `done`
  std::size_t done = 0;
  in_parallel(
      slices_.size(),
      [&](std::size_t k) {
        const ProbeState state =
            press_solid(tissue, slice_window_x_m(tissue), compression_m_, kSpacingM, places_.z_m(k));
        const RfBase base = simulate_rf(tissue, state, RfFrame::kProbe, mixed(tissue.seed) + k);
        for (std::size_t pass = 0; pass < passes; ++pass)
          slices_[k].passes.push_back(
              simulated_pair(base, state, tissue.probe, pass_seed(tissue.seed, k, pass)));
        const std::lock_guard lock(mutex);
        ++done;
        if (progress) progress(done, slices_.size());
      },
      std::min(threads, kMostThreads));
}

std::size_t SolidSource::frames_left(std::size_t slice) const {
  const Slice& s = slices_.at(slice);
  return s.passes.size() - s.taken;
}

FramePair SolidSource::take(std::size_t slice) {
  Slice& s = slices_.at(slice);
  if (s.taken == s.passes.size()) throw std::out_of_range("every prepared pass of this slice is used up");
  return std::move(s.passes[s.taken++]);
}

}  // namespace teletact::client
