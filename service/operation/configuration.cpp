#include "service/operation/configuration.h"

#include <toml++/toml.h>

#include <algorithm>
#include <map>
#include <stdexcept>
#include <utility>
#include <variant>
#include <vector>

#include "common/small_file.h"
#include "service/base/shown.h"

namespace teletact::service {
namespace {

constexpr std::size_t kLongest = 500;  // of what is said of the file's text

toml::table parsed(const std::filesystem::path& path) {
  constexpr std::size_t kMaxBytes = std::size_t{1} << 20;
  try {
    return toml::parse(read_small_stream(path, kMaxBytes));
  } catch (const UnreadFile& error) {
    throw std::runtime_error("--config " + path.string() + ": cannot be read (" + error.what() +
                             "); give a file that this user may read");
  } catch (const toml::parse_error& error) {
    throw std::runtime_error("--config " + path.string() + ": " + shown(error.description(), kLongest) +
                             ", line " + std::to_string(error.source().begin.line));
  }
}

// toml++ gives no double for an integer that is none exactly.
double number_from(const toml::node& node) {
  const toml::value<std::int64_t>* const whole = node.as_integer();
  return whole ? static_cast<double>(whole->get()) : *node.value<double>();
}

// [limits]: any limit by its name (service/base/limits.cpp).
void read_limits(const std::string& where, const toml::node& node, Limits& limits) {
  const toml::table* const table = node.as_table();
  if (!table) throw std::runtime_error(where + "limits must be a table, [limits]");
  for (const auto& [key, value] : *table) {
    if (!value.is_number())
      throw std::runtime_error(where + "limits." + shown(key.str()) + " must be a number");
    try {
      set_limit(limits, key.str(), number_from(value));
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

// Null, or what the node must be and is not. Sets it where it is to be taken.
const char* set(bool& option, const toml::node& node, bool take) {
  if (!node.is_boolean()) return " must be true or false";
  if (take) option = *node.value<bool>();
  return nullptr;
}

const char* set(std::size_t& option, const toml::node& node, bool take) {
  static_assert(kMostAtOnce == 16);
  const auto value = node.value_exact<std::int64_t>().value_or(0);
  if (value < 1 || value > std::int64_t{kMostAtOnce}) return " must be a whole number from 1 to 16";
  if (take) option = static_cast<std::size_t>(value);
  return nullptr;
}

template <class Text>  // std::string, or a path
const char* set(Text& option, const toml::node& node, bool take) {
  if (!node.is_string()) return " must be a string";
  if (take) option = *node.value<std::string>();
  return nullptr;
}

}  // namespace

void read_configuration(const std::function<bool(const std::string& flag)>& given, ServeOptions& options) {
  if (options.config.empty()) return;
  using Path = std::filesystem::path;
  const std::map<std::string, std::variant<std::string*, Path*, bool*, std::size_t*>> keys{
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
      {"pairs_at_once", &options.server.at_once},
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
    const bool take = !given(flag);  // the command line wins
    if (const char* const must =
            std::visit([&, &value = node](auto* option) { return set(*option, value, take); }, known->second))
      throw std::runtime_error(where + name + must);
  }
}

}  // namespace teletact::service
