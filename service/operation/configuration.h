// What the service is started with, and the TOML file that says it.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "service/device/device.h"
#include "service/rpc/server.h"

namespace teletact::service {

struct ServeOptions {
  ServerOptions server;
  std::vector<std::string> devices;  // as choose_devices() takes them; empty: the usual one
  DeviceOptions device;              // of each
  std::string admin;
  std::filesystem::path config;
  std::string log_level = "info";
};

// Reads the file `options.config`; nothing where that is empty. Its keys are the flags' names with '_' for
// '-', and limits. `given`: whether the command line has this flag, which then wins. Throws
// std::runtime_error, one line that names the file and the key: not to be read, no TOML, an unknown key, a
// value of another type or out of its range.
void read_configuration(const std::function<bool(const std::string& flag)>& given, ServeOptions& options);

}  // namespace teletact::service
