#include "bench/load/arrivals.h"

#include <cmath>
#include <limits>
#include <stdexcept>

namespace teletact::bench {

double phase_of(unsigned client) {
  constexpr double kGoldenRatio = 0.6180339887498949;
  return std::fmod(kGoldenRatio * (client + 1), 1.0);
}

Arrivals::Arrivals(const Rate& rate, unsigned client, std::uint64_t seed)
    : rate_(rate), random_(seed * 1000003 + client), expected_(rate.poisson ? 0 : phase_of(client) - 1) {
  if (!(rate.begin_hz > 0 && rate.end_hz > 0 && rate.duration_s > 0))
    throw std::invalid_argument("rate and duration of a load must be above 0");
}

double Arrivals::next() {
  expected_ += rate_.poisson ? std::exponential_distribution<double>(1)(random_) : 1;
  // expected(t) = begin t + (end - begin) t^2 / (2 duration), solved for t; written so that even rates are a
  // case.
  const double growth = (rate_.end_hz - rate_.begin_hz) / rate_.duration_s;
  const double under_root = rate_.begin_hz * rate_.begin_hz + 2 * growth * expected_;
  if (under_root < 0) return std::numeric_limits<double>::infinity();
  const double time_s = 2 * expected_ / (rate_.begin_hz + std::sqrt(under_root));
  return time_s < rate_.duration_s ? time_s : std::numeric_limits<double>::infinity();
}

}  // namespace teletact::bench
