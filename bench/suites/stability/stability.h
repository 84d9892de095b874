// teletact-bench stability: where a touch stays stable (T5), one part each.
#pragma once

#include "bench/run_suite.h"

namespace teletact::bench {

Part stability_passivity();  // hold's passivity border, by its worst imposed motion (T5.2)
Part stability_promise();    // Kalman with tangent where a held 50 Hz force is active
Part stability_law();        // the contact law in place of answers
Part stability_lift();       // presses to the largest force, lifts and taps, by every renderer
Part stability_chart();      // stable, limit cycle, unstable, by every renderer
Part stability_position();   // displays that command a position, through the virtual coupling
Part stability_fuzz();       // any stream of answers

}  // namespace teletact::bench
