#pragma once

namespace teletact::service {

inline double squared(double value) {
  return value * value;
}

}  // namespace teletact::service
