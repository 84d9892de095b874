#include "client/experiment/weibull.h"

#include <cmath>
#include <stdexcept>

namespace teletact::client {
namespace {

constexpr double kLn2 = 0.693147180559945309417;
// (threshold / alpha)^beta: how often the remaining doubt is halved at the threshold.
const double kHalvings = -std::log2(1 - kThresholdProbability);

}  // namespace

double probability_harder(const Weibull& function, double stimulus_n_m) {
  const double sensed =
      -std::expm1(-kLn2 * std::pow(stimulus_n_m / function.alpha_n_m, function.beta));  // p0
  return function.lapse_rate / 2 + (1 - function.lapse_rate) * sensed;
}

double threshold_n_m(const Weibull& function) {
  return function.alpha_n_m * std::pow(kHalvings, 1 / function.beta);
}

Weibull weibull_through(double threshold_n_m, double beta, double lapse_rate) {
  return {threshold_n_m * std::pow(kHalvings, -1 / beta), beta, lapse_rate};
}

double weber_fraction(const Weibull& function, double background_n_m) {
  return threshold_n_m(function) / background_n_m - 1;
}

Weibull psychometric_function(const ObserverDescription& observer, double background_n_m) {
  if (!(background_n_m > 0) || !std::isfinite(background_n_m))
    throw std::invalid_argument("background_n_m: give a stiffness above zero");
  if (!(observer.lapse_rate >= 0 && observer.lapse_rate < 1))
    throw std::invalid_argument("lapse_rate: give a share from 0 to below 1");
  if (!(observer.equality_fraction > -1) ||
      !(observer.weber_fraction > observer.equality_fraction && observer.weber_fraction > 0) ||
      !std::isfinite(observer.weber_fraction))
    throw std::invalid_argument(
        "weber_fraction: give a fraction above zero and above equality_fraction, which is above -1");
  const double alpha_n_m = background_n_m * (1 + observer.equality_fraction);
  const double spread = std::log((1 + observer.weber_fraction) / (1 + observer.equality_fraction));
  return {alpha_n_m, std::log(kHalvings) / spread, observer.lapse_rate};
}

}  // namespace teletact::client
