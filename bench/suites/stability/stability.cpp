// teletact-bench stability: simulated displays and hands about the client's own renderers and servo loop.
#include "bench/suites/stability/stability.h"

namespace teletact::bench {

void add_stability_suite(CLI::App& app, bool& met) {
  add_suite(
      app, "stability",
      "where a touch is stable and passive: renderers against stiffness, rates, delays and devices",
      "passivity: hold's border; promise: the Kalman filter; law: the contact law; lift: presses to the "
      "largest force; chart: all renderers; position: displays that command one; fuzz: any answers",
      {stability_passivity(), stability_promise(), stability_law(), stability_lift(), stability_chart(),
       stability_position(), stability_fuzz()},
      met);
}

}  // namespace teletact::bench
