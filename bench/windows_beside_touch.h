// Windows of imaging, one at a time, while a finger is answered beside them.
#pragma once

#include <functional>
#include <optional>

#include "bench/suite.h"
#include "service/imaging/estimate.h"
#include "tests/reference/contact.h"

namespace teletact::bench {

struct WindowTimes {
  Quantiles displacement_s, strain_s, modulus_s, total_s;
  Quantiles touch_latency_s;  // of the finger; of none where there was none
};
// `touched`: what the finger slides over; none: there is none.
WindowTimes windows_beside_touch(const std::function<service::Estimate()>& window, int windows,
                                 const std::optional<reference::TouchedTissue>& touched);

}  // namespace teletact::bench
