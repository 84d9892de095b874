// Names of the modulus methods and plane conditions on the command line and in files, and the options that
// every command with a modulus has.
#pragma once

#include <CLI/App.hpp>
#include <map>
#include <string>

#include "teletact/v1/elastography.pb.h"

namespace teletact::client {

const std::map<std::string, teletact::v1::ModulusMethod>& modulus_methods();
const std::map<std::string, teletact::v1::PlaneCondition>& plane_conditions();
// "unknown" for a method that this client does not know.
std::string name_of(teletact::v1::ModulusMethod);

// --plane; left alone (unspecified) the service chooses.
void add_plane_option(CLI::App& command, teletact::v1::PlaneCondition& plane);

// --modulus-method and --modulus-time-limit-s; left alone they stay as they are; 0 is
// the service's choice.
void add_modulus_options(CLI::App& command, teletact::v1::ModulusMethod& method, double& time_limit_s);

}  // namespace teletact::client
