// Interpolation of RF by a windowed sinc, as the kernel `warp` reads it.
#pragma once

#include <vector>

namespace teletact::service {

inline constexpr int kInterpolationTaps = 8;
inline constexpr int kInterpolationPhases = 64;

// Row p (of kInterpolationPhases + 1, 8 taps each) interpolates at the fraction f = p / kInterpolationPhases
// between samples 0 and 1 from the samples -3 .. 4: sinc(n - f) with a Kaiser window (beta 5) over 8 samples,
// rows of unit sum. Largest error 0.2 % of the amplitude up to 0.27 of the sampling frequency.
std::vector<float> interpolation_taps();

// The same taps as functions of the distance from a sample, up to kInterpolationRange, as Chebyshev series in
// t = distance / range: the taps at -3 .. 3 have the coefficients [order][|n|], n = 0 .. 3, of
// kInterpolationOrders orders, those of odd orders changing sign with n. Then, in 2 |t| - 1,
// kInterpolationFarOrders coefficients of the tap 4 away on the side of t (the one on the other side is 0)
// and as many of what makes the sum one. They differ from the rows above by less than 2e-4.
inline constexpr double kInterpolationRange = 0.8;  // INTERPOLATION_RANGE of displacement.cl
inline constexpr int kInterpolationOrders = 7, kInterpolationFarOrders = 5;
std::vector<float> interpolation_series();

}  // namespace teletact::service
