// Shifts by parts of a sample against the bound of T2.5.
#include <cmath>

#include "bench/phantoms/bounds.h"
#include "bench/suites/elastography/elastography.h"

namespace teletact::bench {

RigidFigures measure_rigid(const Trackers& trackers, bool quick) {
  const int phases = quick ? 4 : 16;
  const client::Ultrasound u;
  const TrackerOptions o;
  RigidFigures out{displacement_bound_m(u, o.window_axial_m)};
  for (const Tracker& tracker : trackers.usual) out.methods.push_back({tracker.name, tracker.ours});
  for (int phase = 0; phase < phases; ++phase) {
    const double shift_m = u.sample_pitch_m() * phase / phases;
    const Phantom p =
        Phantoms::rigid({0, shift_m}, u.snr_db, u.correlation, 100 + static_cast<unsigned>(phase));
    for (std::size_t m = 0; m < out.methods.size(); ++m) {
      const TrackErrors e = track_errors(trackers.usual[m].track(p.pre, p.post, p.geometry), p);
      out.methods[m].phases.push_back({shift_m, e.axial_rmse_m, e.bias_m});
    }
    out.independent_lines = window_lines(u, o.window_lateral_m, p.geometry.line_pitch_m);
  }
  return out;
}

}  // namespace teletact::bench
