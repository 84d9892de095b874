// Simulated pairs of RF frames as a scanner would hand them over.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "client/acquire/frame_source.h"
#include "client/patient/patient.h"

namespace teletact::client {

// What the probe's sensor shows of a force, and what it states of its errors.
teletact::v1::ProbeForce sensed(const Probe&, const ProbeState&, std::uint64_t seed);

// The passes of a window of a patient: fresh noise in both frames and in the force of each, none of it twice.
// Of maps they ask for `valid` alone.
std::vector<FramePair> simulated_pairs(const Tissue& tissue, const ProbeState& state, std::size_t window,
                                       std::size_t passes);

}  // namespace teletact::client
