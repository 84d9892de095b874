// Axial interpolation of RF by a windowed sinc, as the kernel `warp` reads it.
#pragma once

#include <vector>

namespace teletact::service {

inline constexpr int kInterpolationTaps = 8;
inline constexpr int kInterpolationPhases = 64;

// Row p (of kInterpolationPhases + 1, 8 taps each) interpolates at the fraction f = p / kInterpolationPhases
// between samples 0 and 1 from the samples -3 .. 4: sinc(n - f) with a Kaiser window (beta 5) over 8 samples,
// rows of unit sum. Largest error 0.2 % of the amplitude up to 0.27 of the sampling frequency.
std::vector<float> interpolation_taps();

}  // namespace teletact::service
