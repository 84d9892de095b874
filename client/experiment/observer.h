// Who judges: a simulated observer, or a person at a terminal.
#pragma once

#include <cstdint>
#include <iosfwd>

#include "client/experiment/trials.h"
#include "client/experiment/weibull.h"

namespace teletact::client {

// Judges by chance with the probability of its psychometric function at the stimulus that it is given:
// "perfect stiffness", nothing between the stimulus and the observer.
Observer simulated_observer(const Weibull&, std::uint64_t seed);

// Shows each trial on `out` and reads y or n from `in`; what is neither is asked again; q or the end of the
// input ends the experiment. Both streams outlive the observer.
Observer terminal_observer(std::istream& in, std::ostream& out);

}  // namespace teletact::client
