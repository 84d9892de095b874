// A person who judges: at a haptic device, or at a keyboard alone. Neither is told a stiffness, on the screen
// or otherwise. Answers are read as lines: y or n; a feels both again; q, or the end of the input, ends the
// experiment. The streams outlive the observer.
#pragma once

#include <iosfwd>

#include "client/experiment/stimulus_display.h"
#include "client/experiment/trials.h"

namespace teletact::client {

// Feels both stiffnesses of a trial on the display, which outlives the observer. No answer is taken for an
// interval that was not felt, and a trial of which something was lost is asked again.
Observer device_observer(StimulusDisplay& display, std::istream& in, std::ostream& out);

// Moves a finger by + and - in steps of 0.5 mm and sees the force as a bar, which is full at `full_scale_n`
// (the same for all trials, or the bar would say nothing).
Observer keyboard_observer(std::istream& in, std::ostream& out, double full_scale_n);
constexpr double kKeyboardDeepestM = 0.010;

}  // namespace teletact::client
