// teletact-bench paper fig14|fig15|fig16|psychometric|all: the paper's experiments again, ours beside theirs.
#include "bench/suites/paper/paper.h"

#include <fmt/format.h>

#include <cstdio>
#include <memory>

namespace teletact::bench {
namespace {

using nlohmann::json;

struct Arguments {
  SuiteOptions suite;
  std::string experiment = "all";
};

const std::vector<PaperExperiment>& experiments() {
  static const std::vector<PaperExperiment> all{paper_fig14(), paper_fig15(), paper_fig16(),
                                                paper_psychometric()};
  return all;
}

void draw(const json& result, const std::string& folder) {
  std::filesystem::create_directories(folder);
  for (const PaperExperiment& experiment : experiments())
    if (result.contains(experiment.name)) experiment.draw(result[experiment.name], folder);
}

bool run(const Arguments& arguments) {
  if (replotted(arguments.suite, "paper", draw)) return true;
  json result{{"suite", "paper"}};
  std::vector<Target> targets;
  for (const PaperExperiment& experiment : experiments())
    if (arguments.experiment == "all" || arguments.experiment == experiment.name)
      result[experiment.name] = experiment.measure(arguments.suite.quick, targets);
  const bool met = finish(result, targets, arguments.suite);
  if (!arguments.suite.out.empty()) draw(result, arguments.suite.out);
  return met;
}

}  // namespace

void add_paper_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = *app.add_subcommand("paper", "the source paper's experiments, ours beside theirs");
  std::vector<std::string> names{"all"};
  for (const PaperExperiment& experiment : experiments()) names.emplace_back(experiment.name);
  command
      .add_option("experiment", arguments->experiment,
                  "fig14: what the Kalman filter does to the stiffness (T6.1); fig15: time to solve and "
                  "communicate (T6.2); fig16: touching under the surface "
                  "(T6.3); psychometric: the fits of its tables and simulated observers (T6.4)")
      ->check(CLI::IsMember(names))
      ->capture_default_str();
  add_common_options(command, arguments->suite);
  command.callback([arguments, &met] { met = run(*arguments); });
}

}  // namespace teletact::bench
