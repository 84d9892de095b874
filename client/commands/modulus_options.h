// The options that every command with a modulus has.
#pragma once

#include <CLI/App.hpp>

#include "teletact/v1/elastography.pb.h"

namespace teletact::client {

// --plane; `usual`: what is taken where it is left alone.
void add_plane_option(CLI::App& command, v1::PlaneCondition& plane, const std::string& usual);

// --modulus-method and --modulus-time-limit-s; left alone they stay as they are; 0 is
// the service's choice.
void add_modulus_options(CLI::App& command, v1::ModulusMethod& method, double& time_limit_s);

// How uncertain what is stated of a pair is, each --NAME-std-UNIT, and what of its sensor and its preload is
// not stated elsewhere; and the surface: groups of their own. What is given is set in `stated`, under its
// name in the contract.
void add_uncertainty_options(CLI::App& command, v1::Acquisition& stated);

}  // namespace teletact::client
