// The simulated patient as a frame source: RF of every window is simulated before anything moves, with fresh
// noise, decorrelation and sensor noise for each pass; no noise seed is used twice.
#pragma once

#include "client/acquire/prepared_source.h"
#include "client/patient/patient.h"

namespace teletact::client {

class SimulatedSource final : public PreparedSource {
 public:
  // Simulates floor(tissue width / probe width) windows with `passes` pairs each, one thread per processor.
  // Throws TissueError, std::invalid_argument when no window fits or passes is 0.
  SimulatedSource(const Patient& patient, std::size_t passes, const Progress& progress);

  double window_width_m() const override { return probe_.width_m; }
  double compression_m() const override { return probe_.compression_m; }

 private:
  Probe probe_;
};

}  // namespace teletact::client
