// What was felt in a recorded touch, against the force of the model that was touched at the same poses.
#pragma once

#include <cstddef>
#include <string>

#include "tests/reference/contact.h"

namespace teletact::bench {

// Of the ticks in contact with force on, from half a second after it came on; errors are of force vectors.
struct Felt {
  std::size_t ticks = 0;
  double within_half = 0, within_one = 0;  // share off by at most 0.5 %, or 1 %, and 1 mN
  double error_p50 = 0, error_p95 = 0;     // of the model's force
  double lag_s = 0;                        // of the model's force, by which it fits what was felt best
  double by_law_share = 0;
  double answers_per_s = 0;
  double min_energy_j = 0;  // of the passivity observer: below zero it was generated
  double law_after_s = -1;    // from the stream's begin to columns 10 mm to either side; -1: they never came
};

// Throws BenchError where nothing was felt.
Felt felt_in(const std::string& recording, const reference::TouchedTissue& tissue);

}  // namespace teletact::bench
