// A simulated pair of RF frames as a scanner would hand it over.
#pragma once

#include <cstdint>

#include "client/acquire/frame_source.h"
#include "client/patient/patient.h"
#include "client/patient/rf.h"

namespace teletact::client {

// SplitMix64: neighbouring inputs give unrelated outputs.
std::uint64_t mixed(std::uint64_t seed);

// A seed of its own for every (patient, window, pass): passes never share noise.
std::uint64_t pass_seed(std::uint64_t patient_seed, std::size_t window, std::size_t pass);

// That pass of a window: fresh noise in both frames and in the force. Of maps it asks for `valid` alone.
FramePair simulated_pair(const RfBase& base, const ProbeState& state, const Probe& probe, std::uint64_t seed);

}  // namespace teletact::client
