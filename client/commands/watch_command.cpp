// teletact-client watch: the live page of an operator's session.
#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <thread>

#include "client/commands/commands.h"
#include "client/link/channel.h"
#include "client/link/recording.h"
#include "client/servo/ending.h"
#include "client/watch/gateway.h"
#include "client/watch/player.h"
#include "client/watch/sources.h"

namespace teletact::client {
namespace {

struct WatchArguments {
  std::string session, acquire, address, scene_id, faults;
  std::vector<std::string> recordings;
  Credentials credentials;
  unsigned port = 0;
};

constexpr std::array<const char*, 8> kFaults{"stall", "jitter", "far",          "cut",
                                             "kill",  "force",  "decorrelated", "none"};

// One word a line into a pipe that the demo reads; one that nobody reads takes none.
bool order_fault(const std::string& pipe, const std::string& fault) {
  const FileDescriptor file(::open(pipe.c_str(), O_WRONLY | O_NONBLOCK | O_CLOEXEC));
  const std::string line = fault + "\n";
  return file && ::write(file.get(), line.data(), line.size()) == static_cast<ssize_t>(line.size());
}

Gateway::Orders orders_of(const WatchArguments& arguments, std::optional<Player>& player) {
  if (player) return [&player](const nlohmann::json& order) { player->obey(order); };
  if (arguments.faults.empty()) return {};
  return [pipe = arguments.faults](const nlohmann::json& order) {
    const auto fault = order.find("fault");
    for (const char* known : kFaults)
      if (fault != order.end() && *fault == known && !order_fault(pipe, known))
        say(std::string("fault '") + known + "': no demo listens to it");
  };
}

// A session is waited for where nothing is yet, or an earlier one; what is something else never becomes one.
// `flag`: that the path was given by; `command`: whose recording it is.
void say_waiting(const std::string& flag, const std::string& command, const std::string& path) try {
  if (path.empty()) return;
  const std::string start = "start '" + command + " --record " + path;
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) return say("waiting for " + path + ": " + start + "'");
  if (RecordReader(path).is_written()) return;
  say(path + " has ended: play it with --recording, or " + start + " --force', which is waited for");
} catch (const std::runtime_error& none) {
  throw UsageError(flag + ": " + none.what());
}

void run(const WatchArguments& arguments) {
  if (arguments.session.empty() && arguments.recordings.empty())
    throw UsageError("give --session FILE, which a touch --record writes, or --recording FILE");
  say_waiting("--session", "touch", arguments.session);
  say_waiting("--acquire", "acquire", arguments.acquire);
  const std::atomic<bool>& end = end_in_order();
  View view;
  view.tell("faults", !arguments.faults.empty());
  std::optional<SessionSource> session, acquire;
  std::optional<SceneSource> scene;
  std::optional<Player> player;
  if (!arguments.recordings.empty()) player.emplace(arguments.recordings, view);
  if (player && !player->has_maps() && arguments.address.empty())
    view.tell("no_maps", "no maps in this recording: give acquire.record of the same session, or --service");
  std::optional<Gateway> gateway;
  gateway.emplace(arguments.port, view, orders_of(arguments, player));
  if (!arguments.session.empty()) session.emplace(arguments.session, "session", true, view);
  if (!arguments.acquire.empty()) acquire.emplace(arguments.acquire, "acquire", false, view);
  if (!player || !arguments.address.empty())
    scene.emplace(arguments.address, arguments.credentials, arguments.scene_id, view);
  std::printf("the page is at %s\n", gateway->url().c_str());
  std::fflush(stdout);
  for (; !end; std::this_thread::sleep_for(std::chrono::milliseconds(50)))
    if (plays(player.has_value(), gateway->viewers())) player->begin();
  gateway.reset();
}

}  // namespace

void add_watch_command(CLI::App& app) {
  const auto arguments = std::make_shared<WatchArguments>();
  CLI::App& command = *app.add_subcommand(
      "watch", "operator side: a live page of a session, or of a recording, for a browser here");
  CLI::Option* session =
      command.add_option("--session", arguments->session,
                         "the file that touch --record writes; without it a recording is played");
  command
      .add_option("--acquire", arguments->acquire,
                  "the file that acquire --record writes; without it no windows are seen")
      ->needs(session);
  command
      .add_option("--faults", arguments->faults,
                  "named pipe that takes the page's faults, a word a line; without "
                  "it there are none")
      ->needs(session);
  command
      .add_option("--recording", arguments->recordings,
                  "play recordings instead: touch --record, and with it acquire --record")
      ->excludes(session);
  command.add_option("--service", arguments->address, "where maps come from (default: the session's)")
      ->check(address_problem);
  command.add_option("--scene", arguments->scene_id, "whose maps (default: the session's)");
  command.add_option("--port", arguments->port, "of 127.0.0.1; 0: a free one")->check(CLI::Range(0U, 65535U));
  add_credential_options(command, arguments->credentials);
  command.callback([arguments] { run(*arguments); });
}

}  // namespace teletact::client
