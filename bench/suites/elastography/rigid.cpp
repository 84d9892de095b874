// Acceptance 1a: shifts by parts of a sample against the bound of T2.5.
#include <cmath>

#include "bench/peers/rf_nodes.h"
#include "bench/phantoms/bounds.h"
#include "bench/phantoms/metrics.h"
#include "bench/suites/elastography/elastography.h"

namespace teletact::bench {

using nlohmann::json;

json measure_rigid(const std::vector<std::unique_ptr<Tracker>>& trackers, bool quick) {
  const int phases = quick ? 4 : 16;
  const client::Ultrasound u;
  const TrackerOptions o;
  json out{{"bound_m", displacement_bound_m(u, o.window_axial_m)}, {"methods", json::array()}};
  std::vector<json> rows(trackers.size(), json::array());
  for (int phase = 0; phase < phases; ++phase) {
    const double shift_m = u.sample_pitch_m() * phase / phases;
    const Phantom p =
        Phantoms::rigid({0, shift_m}, u.snr_db, u.correlation, 100 + static_cast<unsigned>(phase));
    for (std::size_t m = 0; m < trackers.size(); ++m) {
      const TrackErrors e = track_errors(trackers[m]->track(p.pre, p.post, p.geometry), p);
      rows[m].push_back({{"shift_m", shift_m}, {"rmse_m", e.axial_rmse_m}, {"bias_m", e.bias_m}});
    }
    const int lines = 1 + 2 * static_cast<int>(std::lround(o.window_lateral_m / 2 / p.geometry.line_pitch_m));
    out["independent_lines"] = independent_lines(u, p.geometry.line_pitch_m, lines);
  }
  for (std::size_t m = 0; m < trackers.size(); ++m)
    out["methods"].push_back(
        {{"method", trackers[m]->name()}, {"ours", trackers[m]->ours()}, {"phases", rows[m]}});
  return out;
}

}  // namespace teletact::bench
