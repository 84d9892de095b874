// Names of the modulus methods and plane conditions, on the command line and in files; the modulus in words.
#pragma once

#include <map>
#include <string>

#include "teletact/v1/elastography.pb.h"

namespace teletact::client {

const std::map<std::string, teletact::v1::ModulusMethod>& modulus_methods();
const std::map<std::string, teletact::v1::PlaneCondition>& plane_conditions();
const std::map<std::string, teletact::v1::SurfaceKind>& surface_kinds();
// "unknown" for a method that this client does not know.
std::string name_of(teletact::v1::ModulusMethod);
// "9.51 kPa (95 %: 8.00 to 11.30)"; without the interval where the median deviation of ln E is not known.
std::string background_of(double background_pa, double log_deviation);

}  // namespace teletact::client
