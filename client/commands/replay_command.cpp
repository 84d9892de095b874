// teletact-client replay: plays a recording again and says how far the answers differ.
#include <cstdio>
#include <memory>

#include "client/commands/commands.h"
#include "client/servo/ending.h"
#include "client/session/replay.h"

namespace teletact::client {
namespace {

void print(const ReplayOptions& options, const ReplayReport& report) {
  std::printf("replayed %s (%s): %lu calls, %lu %s, %lu answers compared, %lu of another status or size%s\n",
              options.path.c_str(), report.kind.c_str(), report.calls, report.requests,
              report.kind == "acquire" ? "RF pairs" : "poses", report.compared, report.not_alike,
              report.truncated ? "; the recording was cut short" : "");
  if (report.alone > 0)
    std::printf("  %lu slices of a solid were estimated without their neighbours, and are not compared\n",
                report.alone);
  if (report.kind == "acquire") {
    std::printf("  largest difference %.3g of the map's largest value (%s)\n", report.largest_map_difference,
                report.largest_map.empty() ? "none" : report.largest_map.c_str());
  } else if (report.forces == 0) {
    std::printf("  no force could be compared\n");
  } else if (report.largest_force_difference_n > 0) {
    std::printf("  largest force difference %.3g N, of %.3g N at x = %.4f m, %lu forces compared\n",
                report.largest_force_difference_n, report.recorded_force_n, report.largest_at_x_m,
                report.forces);
  } else {
    std::printf("  every force as recorded (%lu compared)\n", report.forces);
  }
}

void run(const ReplayOptions& options) {
  ReplayReport report;
  try {
    report = replay(options, end_in_order());
  } catch (const std::exception& error) {
    throw CommandError(error.what());
  }
  print(options, report);
  if (const std::string why = what_is_not_alike(report); !why.empty()) throw CommandError(why);
}

}  // namespace

void add_replay_command(CLI::App& app) {
  const auto options = std::make_shared<ReplayOptions>();
  CLI::App& command = *app.add_subcommand("replay", "play a recording of touch or acquire again");
  command.add_option("file", options->path, "written by touch --record or acquire --record")->required();
  add_service_options(command, options->address, options->credentials);
  command.add_option("--scene", options->scene_id, "play into this scene (default: the recorded one)");
  command
      .add_option("--speed", options->speed,
                  "times the recorded one, above 0; 0 = as fast as the service answers")
      ->check(zero_or_more());
  command.add_option("--record", options->record_path,
                     "record the replay in this file; without it nothing is kept");
  const auto force = std::make_shared<bool>(false);
  add_force_option(command, *force);
  command.callback([options, force] {
    require_different_files(
        {{"the recording that is played", options->path}, {"--record", options->record_path}});
    require_new_files({{"--record", options->record_path}}, *force);
    run(*options);
  });
}

}  // namespace teletact::client
