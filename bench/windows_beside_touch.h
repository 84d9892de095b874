// Windows of imaging, one at a time, while a finger is answered beside them.
#pragma once

#include "bench/phantoms/phantom.h"
#include "bench/suite.h"
#include "service/imaging/estimate.h"

namespace teletact::bench {

struct WindowTimes {
  Quantiles displacement_s, strain_s, modulus_s, total_s;
  Quantiles touch_latency_s;  // of the finger; of none where there was none
};
WindowTimes windows_beside_touch(service::Elastography&, service::ModulusKind, const Phantom&, int windows,
                                 bool touch = true);

}  // namespace teletact::bench
