// teletact-bench paper fig14|fig15|fig16|psychometric|all: the paper's experiments again, ours beside theirs.
#include "bench/suites/paper/paper.h"

#include <CLI/CLI.hpp>
#include <memory>

namespace teletact::bench {

void add_paper_suite(CLI::App& app, bool& met) {
  struct Arguments : SuiteOptions {
    std::string experiment = "all";
  };
  const auto arguments = std::make_shared<Arguments>();
  const std::vector<Part> parts{paper_fig14(), paper_fig15(), paper_fig16(), paper_psychometric()};
  CLI::App& command =
      add_suite(app, "paper", "the source paper's experiments, ours beside theirs", *arguments, met,
                [arguments, parts] { return run_parts("paper", parts, arguments->experiment, *arguments); });
  std::vector<std::string> names{"all"};
  for (const Part& part : parts) names.emplace_back(part.name);
  command
      .add_option("experiment", arguments->experiment,
                  "fig14: what the Kalman filter does to the stiffness (T6.1); fig15: time to solve and "
                  "communicate (T6.2); fig16: touching under the surface "
                  "(T6.3); psychometric: the fits of its tables and simulated observers (T6.4)")
      ->check(CLI::IsMember(names))
      ->capture_default_str();
}

}  // namespace teletact::bench
