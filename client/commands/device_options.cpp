#include "client/commands/device_options.h"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <map>
#include <stdexcept>

#include "client/session/devices.h"
#include "client/text/shown.h"
#include "common/small_file.h"

namespace teletact::client {
namespace {

bool has_option(const std::string& device, const CLI::Option& option) {
  if (option.get_group() == kRealDevice) return is_real(device);
  if (option.get_group() != kSimulatedDevice) return true;
  const bool replayed = device.rfind("replay:", 0) == 0;
  return !is_real(device) && (!replayed || option.get_name() == "--profile");
}

toml::table parsed(const std::string& path) {
  constexpr std::size_t kMaxBytes = std::size_t{1} << 20, kLongest = 500;
  const std::string where = "--device-settings " + path + ": ";
  try {
    return toml::parse(read_small_stream(path, kMaxBytes));
  } catch (const UnreadFile& error) {
    throw UsageError(where + "cannot be read (" + error.what() + "); give a file that this user may read");
  } catch (const toml::parse_error& error) {
    throw UsageError(
        fmt::format("{}{}, line {}", where, shown(error.description(), kLongest), error.source().begin.line));
  }
}

// As the command line would have it.
std::string text_of(const toml::node& node, bool is_flag) {
  if (is_flag && !node.is_boolean()) throw std::invalid_argument("must be true or false");
  if (const auto* text = node.as_string()) return text->get();
  if (const auto* whole = node.as_integer()) return std::to_string(whole->get());
  if (const auto* number = node.as_floating_point()) return fmt::format("{}", number->get());
  if (const auto* flag = node.as_boolean(); flag && is_flag) return flag->get() ? "true" : "false";
  throw std::invalid_argument("must be a number or a string");
}

void take_settings(CLI::App& command, const std::string& path) {
  std::map<std::string, CLI::Option*, std::less<>> options;
  std::string known;
  for (CLI::Option* option : command.get_options()) {
    const std::string group = option->get_group();
    if (option->get_name() != "--device" && group != kRealDevice && group != kSimulatedDevice) continue;
    std::string key = option->get_lnames().front();
    std::replace(key.begin(), key.end(), '-', '_');
    known += (known.empty() ? "" : ", ") + key;
    options.emplace(std::move(key), option);
  }
  for (const auto& [key, node] : parsed(path)) {
    const auto refuse = [&, &key = key, &node = node](const std::string& why) {
      throw UsageError(fmt::format("--device-settings {}, line {}: {}: {}", path, node.source().begin.line,
                                   shown(key.str()), why));
    };
    const auto found = options.find(key.str());
    if (found == options.end()) refuse("unknown key; known: " + known);
    CLI::Option& option = *found->second;
    if (option.count() > 0) continue;  // given on the command line
    try {
      option.add_result(text_of(node, option.get_items_expected_max() == 0));
      option.run_callback();
    } catch (const std::exception& error) {
      refuse(error.what());
    }
  }
}

}  // namespace

void add_device_settings(CLI::App& command) {
  command.add_option_function<std::string>(
      "--device-settings", [&command](const std::string& path) { take_settings(command, path); },
      "TOML file with the device and its options, named as in the groups below (scale = 4); the command "
      "line wins; without it they have their defaults");
}

void add_workspace_options(CLI::App& command, WorkspaceOptions& workspace) {
  command.option_defaults()->group(kRealDevice);
  command.add_option("--axes", workspace.axes,
                     "which of its axes moves the finger along x, y and z, such as z,y,-x");
  command.add_option("--rotation-deg", workspace.rotation_deg,
                     "how far it stands turned to the left, seen from above");
  command.add_option("--clutch-button", workspace.clutch_button,
                     "while this button is down the device moves and the finger stays; 0: no button");
  command.add_flag("--device-without-noise", workspace.without_noise,
                   "its positions have no noise: standing still to the last bit under force for 0.1 s is not "
                   "a FAULT");
}

void add_scale_options(CLI::App& command, WorkspaceOptions& workspace) {
  command.option_defaults()->group(kRealDevice);
  command.add_option("--scale", workspace.scale,
                     "metres of the scene per metre of the device, 1 to 20: multiplies the stiffness at the "
                     "hand, unless --force-scale reduces it");
  command.add_option("--force-scale", workspace.force_scale,
                     "newtons at the hand per newton of the tissue, 0.05 to --scale");
}

void require_device_options(const CLI::App& command, const std::string& device,
                            const WorkspaceOptions& workspace) {
  for (const CLI::Option* option : command.get_options())
    if (option->count() > 0 && !has_option(device, *option))
      throw UsageError(fmt::format("{}: {} has no such option ('{}' in --help); leave it out",
                                   option->get_name(), device.empty() ? "the keyboard" : "--device " + device,
                                   option->get_group()));
  try {
    validate(workspace);
  } catch (const std::invalid_argument& error) {
    throw UsageError(with_flags(error.what(), {{"axes", "--axes"},
                                               {"rotation_deg", "--rotation-deg"},
                                               {"force_scale", "--force-scale"},
                                               {"scale", "--scale"},
                                               {"clutch_button", "--clutch-button"}}));
  }
}

}  // namespace teletact::client
