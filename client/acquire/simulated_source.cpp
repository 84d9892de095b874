#include "client/acquire/simulated_source.h"

#include "client/acquire/simulated_pair.h"

namespace teletact::client {

SimulatedSource::SimulatedSource(const Patient& patient, std::size_t passes, const Progress& progress)
    : probe_(patient.tissue().probe) {
  const auto windows = static_cast<std::size_t>(patient.tissue().width_m / probe_.width_m + 1e-6);
  prepare(windows, passes, progress, [&](std::size_t k) {
    const ProbeState state = patient.press(static_cast<double>(k) * probe_.width_m, probe_.compression_m);
    return simulated_pairs(patient.tissue(), state, k, passes);
  });
}

}  // namespace teletact::client
