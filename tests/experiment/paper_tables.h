// The paper's answers (T6.4, its Tables 2 and 3).
#pragma once

#include <vector>

#include "client/experiment/trials.h"

namespace teletact::client {

inline std::vector<StimulusCount> perfect_stiffness_answers() {
  return {{27.5, 2, 8}, {30, 3, 6}, {32.5, 2, 3}, {35, 5, 2}, {37.5, 5, 0}};
}

inline std::vector<StimulusCount> kalman_answers() {
  return {{27.5, 3, 2}, {30, 3, 2}, {32.5, 4, 1}, {35, 5, 0}, {37.5, 5, 0}};
}

}  // namespace teletact::client
