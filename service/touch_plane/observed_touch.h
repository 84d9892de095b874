// An answer of a touch stream as those get it who look on.
#pragma once

#include <chrono>

#include "service/touch_plane/touch_stream.h"

namespace teletact::service {

struct ObservedTouch {
  TouchStream::Answered answered;  // without pressure and tactile image
  std::chrono::steady_clock::time_point at;
};

}  // namespace teletact::service
