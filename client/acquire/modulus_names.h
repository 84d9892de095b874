// Names of the modulus methods and plane conditions, on the command line and in files; the modulus in words.
#pragma once

#include <map>
#include <string>

#include "teletact/v1/elastography.pb.h"

namespace teletact::client {

const std::map<std::string, teletact::v1::ModulusMethod>& modulus_methods();
const std::map<std::string, teletact::v1::PlaneCondition>& plane_conditions();
// "unknown" for a method that this client does not know.
std::string name_of(teletact::v1::ModulusMethod);
// "9.51 kPa +- 9 %": the background's, and the median of its standard deviations where the service states it.
std::string background_of(const teletact::v1::EstimateSummary&);

}  // namespace teletact::client
