// Whether the tissue ends where that is stated: what lies below a rigid support does not strain.
#pragma once

#include "service/imaging/modulus/tissue_extent.h"
#include "service/imaging/tracking/measured.h"

namespace teletact::service {

// How deep there is strain where that is well below the depth that is stated; 0: it is not. `kernel_m`: the
// axial length over which the strain is a mean.
double strained_below(const TissueExtent&, const Measured&, double kernel_m);

// Not stated, as deep as there is strain, where that is well below the depth that is.
TissueExtent believed(TissueExtent, const Measured&, double kernel_m);

}  // namespace teletact::service
