#include "client/commands/modulus_options.h"

#include <CLI/CLI.hpp>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "client/acquire/modulus_names.h"
#include "client/commands/commands.h"

namespace teletact::client {
namespace {

template <class Value>
CLI::Option* add_named(CLI::App& command, const std::string& flag, Value& value,
                       const std::map<std::string, Value>& names, const std::string& help) {
  std::vector<std::string> allowed;
  allowed.reserve(names.size());
  for (const auto& named : names) allowed.push_back(named.first);
  return command
      .add_option_function<std::string>(
          flag, [&value, &names](const std::string& name) { value = names.at(name); }, help)
      ->transform(CLI::IsMember(allowed, CLI::ignore_case));
}

}  // namespace

void add_plane_option(CLI::App& command, v1::PlaneCondition& plane, const std::string& usual) {
  add_named(
      command, "--plane", plane, plane_conditions(),
      "solid: tissue that continues around a narrow probe, ends beside it, or is as wide as the probe, as "
      "the strain shows; strain: the tissue's neighbours hold it; stress: a thin slice (default: " +
          usual + ")");
}

void add_modulus_options(CLI::App& command, v1::ModulusMethod& method, double& time_limit_s) {
  add_named(command, "--modulus-method", method, modulus_methods(),
            "reference-stress, direct or iterative (default: the service chooses by what the force needs and "
            "the time leaves); a solid has its own");
  command
      .add_option(
          "--modulus-time-limit-s", time_limit_s,
          "longest work on the modulus, predicted in seconds of a typical core; a service allows at most "
          "60 s unless its limits say otherwise")
      ->check(above_zero())
      ->default_str(time_limit_s > 0 ? std::to_string(std::lround(time_limit_s)) : "what the finger leaves");
}

}  // namespace teletact::client
