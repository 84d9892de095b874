// What hours of samples of a process say of its growth, and how surely.
#pragma once

#include <array>
#include <vector>

namespace teletact::bench {

// Of a straight line by least squares: units of the samples per hour.
struct Trend {
  double per_hour = 0;
  double upper_95 = 0;  // the slope is below it with 95 % confidence, one-sided; NaN: not enough is known
};

// `samples`: s and a value, evenly spaced. A value that stays for long is no news each time: the slope's
// standard error counts n (1 - r) / (1 + r) samples, r the correlation of one residual with the next (Santer
// et al. 2000, J. Geophys. Res. 105, 7337, equations 4 to 6), and Student's t of two fewer.
Trend trend_of(const std::vector<std::array<double, 2>>& samples);

}  // namespace teletact::bench
