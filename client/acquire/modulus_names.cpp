#include "client/acquire/modulus_names.h"

#include <CLI/CLI.hpp>
#include <cmath>
#include <vector>

namespace teletact::client {

namespace v1 = ::teletact::v1;

const std::map<std::string, v1::ModulusMethod>& modulus_methods() {
  static const std::map<std::string, v1::ModulusMethod> names{
      {"reference-stress", v1::MODULUS_METHOD_REFERENCE_STRESS},
      {"direct", v1::MODULUS_METHOD_DIRECT},
      {"iterative", v1::MODULUS_METHOD_ITERATIVE}};
  return names;
}

const std::map<std::string, v1::PlaneCondition>& plane_conditions() {
  static const std::map<std::string, v1::PlaneCondition> names{{"strain", v1::PLANE_CONDITION_STRAIN},
                                                               {"stress", v1::PLANE_CONDITION_STRESS}};
  return names;
}

std::string name_of(v1::ModulusMethod method) {
  for (const auto& [name, value] : modulus_methods())
    if (value == method) return name;
  return "unknown";
}

namespace {

template <class Value>
CLI::Option* add_named(CLI::App& command, const std::string& flag, Value& value,
                       const std::map<std::string, Value>& names, const std::string& help) {
  std::vector<std::string> allowed;
  for (const auto& named : names) allowed.push_back(named.first);
  return command
      .add_option_function<std::string>(
          flag, [&value, &names](const std::string& name) { value = names.at(name); }, help)
      ->transform(CLI::IsMember(allowed, CLI::ignore_case));
}

}  // namespace

void add_plane_option(CLI::App& command, v1::PlaneCondition& plane) {
  add_named(command, "--plane", plane, plane_conditions(),
            "strain: the tissue's neighbours hold it (default); stress: a thin slice");
}

void add_modulus_options(CLI::App& command, v1::ModulusMethod& method, double& time_limit_s) {
  add_named(command, "--modulus-method", method, modulus_methods(),
            "reference-stress, direct or iterative (the service's choice)");
  command
      .add_option("--modulus-time-limit-s", time_limit_s,
                  "an iterative modulus begins no step that would end later, and returns its best (" +
                      (time_limit_s > 0 ? std::to_string(std::lround(time_limit_s)) : "0.35") + ")")
      ->check(CLI::PositiveNumber);
}

}  // namespace teletact::client
