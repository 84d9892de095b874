// A modulus against what other windows, or this one before, told of the same tissue.
#pragma once

#include "service/imaging/modulus/modulus.h"

namespace teletact::service {

// Of log E: in deviations of both, with those of both forces, the other taken for as uncertain as this one;
// and by how much this one is above. 0 where too little is shared.
struct Disagreement {
  double deviations = 0, shift = 0;
};

// The worst of three: under the window, and across each of its borders. Of an absolute modulus that has its
// common_deviation.
Disagreement worst_disagreement(const ModulusInput&, const ModulusEstimate&);

}  // namespace teletact::service
