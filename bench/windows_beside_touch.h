// Windows of imaging, one at a time or several at once, while a finger is answered beside them.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "bench/suite.h"
#include "service/imaging/estimate.h"
#include "tests/reference/contact.h"

namespace teletact::bench {

struct WindowTimes {
  double windows_s = 0;  // all together
  Quantiles displacement_s, strain_s, modulus_s, total_s;
  Quantiles touch_latency_s;  // of the finger; of none where there was none
};
// Each of `at_once` is asked for so many windows. `touched`: what the finger slides over; none: there is
// none.
WindowTimes windows_beside_touch(const std::vector<std::function<service::Estimate()>>& at_once, int windows,
                                 const std::optional<reference::TouchedTissue>& touched);

}  // namespace teletact::bench
