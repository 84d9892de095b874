#pragma once

#include <fmt/format.h>

#include <stdexcept>

namespace teletact::service {

// Throws std::invalid_argument, one line with the field and the remedy, for a value outside of the two and
// for NaN.
template <class T>
void require_between(const char* field, T value, T least, T most, const char* remedy) {
  if (value >= least && value <= most) return;
  throw std::invalid_argument(
      fmt::format("{}: {} is not within [{}, {}]; {}", field, value, least, most, remedy));
}

}  // namespace teletact::service
