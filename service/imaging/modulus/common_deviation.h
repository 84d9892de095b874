// What is stated of probe and tissue, and uncertain, leaves open of log E everywhere alike (T3.10).
#pragma once

#include "service/imaging/modulus/modulus.h"

namespace teletact::service {

// By force, area and preload, Poisson ratio, speed of sound, a plane's depth and width. 0 of a relative
// modulus, which has no scale.
double common_deviation(const ModulusInput&, StripCache&, const ModulusEstimate&);

}  // namespace teletact::service
