// A simulated observer; people are in person.h.
#pragma once

#include <cstdint>

#include "client/experiment/trials.h"
#include "client/experiment/weibull.h"

namespace teletact::client {

// Judges by chance with the probability of its psychometric function at the stimulus that it is given:
// "perfect stiffness", nothing between the stimulus and the observer.
Observer simulated_observer(const Weibull&, std::uint64_t seed);

}  // namespace teletact::client
