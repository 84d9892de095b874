#include "bench/load/trend.h"

#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <limits>

namespace teletact::bench {
namespace {

constexpr double kTrendConfidence = 0.95, kHourS = 3600;

}  // namespace

Trend trend_of(const std::vector<std::array<double, 2>>& samples) {
  const auto n = static_cast<double>(samples.size());
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  if (n < 3) return {kUnknown, kUnknown};
  const double first = samples.front()[1];  // taken off: what never moves is so without rounding
  double mean_t = 0, mean_v = 0;
  for (const auto& [t, v] : samples) mean_t += t / n, mean_v += (v - first) / n;
  double tt = 0, tv = 0;
  for (const auto& [t, v] : samples)
    tt += (t - mean_t) * (t - mean_t), tv += (t - mean_t) * (v - first - mean_v);
  const double slope = tv / tt;
  double squares = 0, products = 0, before = 0;
  for (const auto& [t, v] : samples) {
    const double residual = v - first - mean_v - slope * (t - mean_t);
    squares += residual * residual, products += residual * before;
    before = residual;
  }
  if (squares == 0) return {kHourS * slope, kHourS * slope};
  const double correlation = std::max(products / squares, 0.0);
  const double free = n * (1 - correlation) / (1 + correlation) - 2;
  if (!(free >= 1)) return {kHourS * slope, kUnknown};
  const double error = std::sqrt(squares / free / tt);
  const double t = boost::math::quantile(boost::math::students_t(free), kTrendConfidence);
  return {kHourS * slope, kHourS * (slope + t * error)};
}

}  // namespace teletact::bench
