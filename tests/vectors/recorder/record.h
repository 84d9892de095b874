// What is recorded. Nothing in it depends on time, threads or addresses.
#pragma once

#include "tests/vectors/recorder/recording.h"

namespace teletact::vectors {

// What machines may differ by. Maps come from float kernels that each processor sums in its own order, and a
// node at the border of what is trusted may be trusted on one machine alone. The modulus is found by
// iterations that stop when they change little: what is left of them is another. Touches and ticks are double
// precision; columns by conjugate gradients are solved in it up to their tolerance.
inline constexpr Tolerance kExact{0, 0}, kMap{1e-3, 0.05}, kModulus{2e-2, 0.05}, kTouch{1e-6, 0},
    kIterativeTouch{1e-5, 0}, kServo{1e-9, 0};

void record_estimates(Recording&);  // three simulated patients, each by three methods
void record_touches(Recording&);    // 10 000 answers on ten tissues, and some by conjugate gradients
void record_servo(Recording&);      // ten seconds at 1 kHz with the Kalman filter

Recording record_all();

}  // namespace teletact::vectors
