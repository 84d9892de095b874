// teletact-bench solid: touch of solid tissue by conjugate gradients that layered tissue preconditions.
#include "bench/suites/solid/solid.h"

namespace teletact::bench {

void add_solid_suite(CLI::App& app, bool& met) {
  add_suite(
      app, "solid", "touch of solid tissue: iterations, what is certified, time and memory",
      "exact: forces that are known otherwise; iterations: to a true and to a certified error; bound: what "
      "is "
      "certified over the true error; speed: time and memory, beside a sparse factor and plain conjugate "
      "gradients; plane: one element thick; sweep: a fast finger's answers at 1 kHz; law: "
      "a contact law over an area; paths: ways over simulated patients as planned; tactile: images of a "
      "lump",
      {solid_exact(), solid_iterations(), solid_bound(), solid_speed(), solid_plane(), solid_sweep(),
       solid_law(), solid_paths(), solid_tactile()},
      met);
}

}  // namespace teletact::bench
