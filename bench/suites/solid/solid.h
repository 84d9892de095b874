// teletact-bench solid: touch of solid tissue (T8), one part each.
#pragma once

#include "bench/run_suite.h"

namespace teletact::bench {

Part solid_iterations();  // to a true and to a certified error, over contrast, texture, nu, sizes and shapes
Part solid_exact();  // the exact layer, lumps, plane strain, a sparse factor; the tangent of what was learned
Part solid_bound();  // what is certified over the true error, at every iteration of random touches
Part solid_speed();  // time and memory, beside a sparse factor and plain conjugate gradients
Part solid_plane();  // one element thick: the plane solver's compliance
Part solid_sweep();  // a fast finger's answers at 1 kHz beside the converged contact, and what they state
Part solid_law();    // the contact law over an area: its guess, its correction, and what either is off by
Part solid_paths();  // ways over simulated patients: what the planner's answers state, and what they take
Part solid_tactile();  // images of a lump under a rounded tip and a pad, and how well it is seen

}  // namespace teletact::bench
