// One figure that the project promises, as it was measured.
#pragma once

#include <string>

namespace teletact::client {

struct Promise {
  std::string name;
  double value = 0, target = 0;
  std::string unit{};
  bool at_most = true;                                                      // else at least
  bool met() const { return at_most ? value <= target : value >= target; }  // false for NaN
};

}  // namespace teletact::client
