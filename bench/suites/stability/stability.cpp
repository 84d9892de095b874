// teletact-bench stability: simulated displays and hands about the client's own renderers and servo loop.
#include "bench/suites/stability/stability.h"

#include <memory>

namespace teletact::bench {

void add_stability_suite(CLI::App& app, bool& met) {
  const auto options = std::make_shared<SuiteOptions>();
  add_suite(app, "stability",
            "where a touch is stable and passive: renderers against stiffness, rates, delays and devices",
            *options, met, [options] {
              return run_parts("stability",
                               {stability_passivity(), stability_promise(), stability_lift(),
                                stability_chart(), stability_position(), stability_fuzz()},
                               "all", *options);
            });
}

}  // namespace teletact::bench
