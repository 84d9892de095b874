#include "client/acquire/simulated_source.h"

#include <algorithm>
#include <mutex>
#include <stdexcept>

#include "client/acquire/simulated_pair.h"
#include "client/patient/parallel.h"

namespace teletact::client {
SimulatedSource::SimulatedSource(const Patient& patient, std::size_t passes, unsigned threads,
                                 const Progress& progress)
    : probe_(patient.tissue().probe),
      windows_(static_cast<std::size_t>(patient.tissue().width_m / patient.tissue().probe.width_m + 1e-6)) {
  if (windows_.empty()) throw std::invalid_argument("the tissue is narrower than the probe");
  if (passes == 0) throw std::invalid_argument("at least one pass must be prepared");
  std::mutex mutex;  // guards `done`
  std::size_t done = 0;
  in_parallel(
      windows_.size(),
      [&](std::size_t k) {
        simulate(patient, k, passes);
        const std::lock_guard lock(mutex);
        ++done;
        if (progress) progress(done, windows_.size());
      },
      threads);
}

void SimulatedSource::simulate(const Patient& patient, std::size_t window, std::size_t passes) {
  const ProbeState state = patient.press(window * probe_.width_m, probe_.compression_m);
  const RfBase base =
      simulate_rf(patient.tissue(), state, RfFrame::kProbe, mixed(patient.tissue().seed) + window);
  windows_[window].passes.reserve(passes);
  for (std::size_t pass = 0; pass < passes; ++pass) {
    const std::uint64_t seed = pass_seed(patient.tissue().seed, window, pass);
    windows_[window].passes.push_back(simulated_pair(base, state, probe_, seed));
  }
}

std::size_t SimulatedSource::frames_left(std::size_t window) const {
  const Window& w = windows_.at(window);
  return w.passes.size() - w.taken;
}

FramePair SimulatedSource::take(std::size_t window) {
  Window& w = windows_.at(window);
  if (w.taken == w.passes.size()) throw std::out_of_range("every prepared pass of this window is used up");
  return std::move(w.passes[w.taken++]);
}

}  // namespace teletact::client
