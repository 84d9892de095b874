// teletact-bench stability: simulated displays and hands about the client's own renderers and servo loop.
#include "bench/suites/stability/stability.h"

#include <memory>

namespace teletact::bench {
namespace {

using nlohmann::json;

const std::vector<StabilityPart>& parts() {
  static const std::vector<StabilityPart> all{stability_passivity(), stability_promise(),  stability_lift(),
                                              stability_chart(),     stability_position(), stability_fuzz()};
  return all;
}

void draw(const json& result, const std::string& folder) {
  std::filesystem::create_directories(folder);
  for (const StabilityPart& part : parts())
    if (part.draw != nullptr && result.contains(part.name)) part.draw(result[part.name], folder);
}

bool run(const SuiteOptions& options) {
  if (replotted(options, "stability", draw)) return true;
  json result{{"suite", "stability"}};
  std::vector<Target> targets;
  for (const StabilityPart& part : parts()) result[part.name] = part.measure(options.quick, targets);
  const bool met = finish(result, targets, options);
  if (!options.out.empty()) draw(result, options.out);
  return met;
}

}  // namespace

void add_stability_suite(CLI::App& app, bool& met) {
  const auto options = std::make_shared<SuiteOptions>();
  CLI::App& command = *app.add_subcommand(
      "stability",
      "where a touch is stable and passive: renderers against stiffness, rates, delays and devices");
  add_common_options(command, *options);
  command.callback([options, &met] { met = run(*options); });
}

}  // namespace teletact::bench
