#include "service/configuration/configuration.h"

#include <toml++/toml.h>

#include <algorithm>
#include <map>
#include <stdexcept>
#include <utility>
#include <variant>
#include <vector>

#include "service/limits/shown.h"

namespace teletact::service {
namespace {

constexpr std::size_t kLongest = 500;  // of what is said of the file's text

toml::table parsed(const std::filesystem::path& path) {
  try {
    return toml::parse_file(path.string());
  } catch (const toml::parse_error& error) {
    throw std::runtime_error("--config " + path.string() + ": " + shown(error.description(), kLongest) +
                             ", line " + std::to_string(error.source().begin.line));
  }
}

// [limits]: any limit by its name (service/limits/limits.cpp).
void read_limits(const std::string& where, const toml::node& node, Limits& limits) {
  const toml::table* const table = node.as_table();
  if (!table) throw std::runtime_error(where + "limits must be a table, [limits]");
  for (const auto& [key, value] : *table) {
    if (!value.is_number())
      throw std::runtime_error(where + "limits." + shown(key.str()) + " must be a number");
    // toml++ gives no double for an integer that is none exactly.
    const toml::value<std::int64_t>* const whole = value.as_integer();
    try {
      set_limit(limits, key.str(), whole ? static_cast<double>(whole->get()) : *value.value<double>());
    } catch (const std::invalid_argument& error) {
      throw std::runtime_error(where + "limits." + shown(error.what(), kLongest));
    }
  }
}

// One of them, or a list.
std::vector<std::string> devices_from(const std::string& where, const toml::node& node) {
  std::vector<std::string> devices;
  const auto add = [&](const toml::node& one) {
    if (!one.is_string()) throw std::runtime_error(where + "device must be a string, or a list of strings");
    devices.push_back(*one.value<std::string>());
  };
  if (const toml::array* const list = node.as_array())
    for (const toml::node& one : *list) add(one);
  else
    add(node);
  if (devices.empty()) throw std::runtime_error(where + "device is an empty list; name one, or leave it out");
  return devices;
}

}  // namespace

void read_configuration(const std::function<bool(const std::string& flag)>& given, ServeOptions& options) {
  if (options.config.empty()) return;
  using Path = std::filesystem::path;
  const std::map<std::string, std::variant<std::string*, Path*, bool*>> keys{
      {"listen", &options.server.listen.listen},
      {"admin", &options.admin},
      {"state", &options.server.state_directory},
      {"kernel_directory", &options.device.kernel_directory},
      {"tls_certificate", &options.server.listen.tls_certificate},
      {"tls_key", &options.server.listen.tls_key},
      {"tls_client_ca", &options.server.listen.tls_client_ca},
      {"access", &options.server.listen.access},
      {"log_level", &options.log_level},
      {"standby", &options.server.standby},
      {"allow_insecure_remote", &options.server.listen.allow_insecure_remote}};
  for (const auto& [key, node] : parsed(options.config)) {
    const std::string name(key.str()), where = "--config " + options.config.string() + ": ";
    if (name == "limits") {
      read_limits(where, node, options.server.limits);
      continue;
    }
    if (name == "device") {
      std::vector<std::string> devices = devices_from(where, node);
      if (!given("--device")) options.devices = std::move(devices);
      continue;
    }
    const auto known = keys.find(name);
    if (known == keys.end()) throw std::runtime_error(where + "unknown key \"" + shown(name) + "\"");
    std::string flag = "--" + name;
    std::replace(flag.begin(), flag.end(), '_', '-');
    bool* const* const yes = std::get_if<bool*>(&known->second);
    if (yes ? !node.is_boolean() : !node.is_string())
      throw std::runtime_error(where + name + (yes ? " must be true or false" : " must be a string"));
    if (given(flag)) continue;  // the command line wins
    if (yes)
      **yes = *node.value<bool>();
    else if (Path* const* path = std::get_if<Path*>(&known->second))
      **path = *node.value<std::string>();
    else
      *std::get<std::string*>(known->second) = *node.value<std::string>();
  }
}

}  // namespace teletact::service
