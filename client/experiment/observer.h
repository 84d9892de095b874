// Simulated observers; people are in person.h. Each has one chance of each trial, by its number: who goes on
// with an experiment that ended judges as if it had not.
#pragma once

#include <atomic>
#include <cstdint>
#include <iosfwd>

#include "client/experiment/stimulus_display.h"
#include "client/experiment/trials.h"
#include "client/experiment/weibull.h"

namespace teletact::client {

// Judges by chance with the probability of its psychometric function at the stimulus that it is given:
// "perfect stiffness", nothing between the stimulus and the observer.
Observer simulated_observer(const Weibull&, std::uint64_t seed);

// The same of what it feels: both stiffnesses of a trial are felt on the display by a device that presses by
// itself, and the stimulus is judged as the one felt, over the background as felt, makes it. With perfect
// stiffness it judges as simulated_observer() of that seed does. A trial of which something was lost is felt
// again. Ends with `stop`. Says what it does in `out`. All borrowed. Throws std::runtime_error where nothing
// is felt for 30 s.
Observer touching_observer(StimulusDisplay&, const Weibull&, std::uint64_t seed,
                           const std::atomic<bool>& stop, std::ostream& out);

}  // namespace teletact::client
