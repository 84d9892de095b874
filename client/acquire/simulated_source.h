// The simulated patient as a frame source: RF of every window is simulated before anything moves, with fresh
// noise, decorrelation and sensor noise for each pass; no noise seed is used twice.
#pragma once

#include <functional>
#include <vector>

#include "client/acquire/frame_source.h"
#include "client/patient/patient.h"

namespace teletact::client {

class SimulatedSource final : public FrameSource {
 public:
  // `progress(done, total)` counts windows; it is called from worker threads, one at a time.
  using Progress = std::function<void(std::size_t done, std::size_t total)>;

  // Simulates floor(tissue width / probe width) windows with `passes` pairs each, on `threads` threads (0:
  // one per processor). Throws TissueError, std::invalid_argument when no window fits or passes is 0.
  SimulatedSource(const Patient& patient, std::size_t passes, unsigned threads, const Progress& progress);

  std::size_t window_count() const override { return windows_.size(); }
  double window_width_m() const override { return probe_.width_m; }
  double compression_m() const override { return probe_.compression_m; }
  std::size_t frames_left(std::size_t window) const override;
  FramePair take(std::size_t window) override;

 private:
  struct Window {
    std::vector<FramePair> passes;
    std::size_t taken = 0;
  };
  void simulate(const Patient& patient, std::size_t window, std::size_t passes);

  Probe probe_;
  std::vector<Window> windows_;
};

}  // namespace teletact::client
