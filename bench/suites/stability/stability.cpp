// teletact-bench stability: simulated displays and hands about the client's own renderers and servo loop.
#include "bench/suites/stability/stability.h"

#include <CLI/CLI.hpp>
#include <memory>

namespace teletact::bench {

void add_stability_suite(CLI::App& app, bool& met) {
  struct Arguments : SuiteOptions {
    std::string experiment = "all";
  };
  const auto arguments = std::make_shared<Arguments>();
  const std::vector<Part> parts{stability_passivity(), stability_promise(), stability_law(),
                                stability_lift(),      stability_chart(),   stability_position(),
                                stability_fuzz()};
  CLI::App& command = add_suite(
      app, "stability",
      "where a touch is stable and passive: renderers against stiffness, rates, delays and devices",
      *arguments, met,
      [arguments, parts] { return run_parts("stability", parts, arguments->experiment, *arguments); });
  std::vector<std::string> names{"all"};
  for (const Part& part : parts) names.emplace_back(part.name);
  command
      .add_option(
          "experiment", arguments->experiment,
          "passivity: hold's border; promise: the Kalman filter; law: the contact law; lift: presses to "
          "the largest force; chart: all renderers; position: displays that command one; fuzz: any answers")
      ->check(CLI::IsMember(names))
      ->capture_default_str();
}

}  // namespace teletact::bench
