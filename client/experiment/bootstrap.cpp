#include "client/experiment/bootstrap.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace teletact::client {

Interval percentiles(std::vector<double> values, double confidence) {
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    const double place = std::clamp(share * (static_cast<double>(values.size()) + 1) - 1, 0.0,
                                    static_cast<double>(values.size() - 1));
    const auto below = static_cast<std::size_t>(place);
    const auto above = std::min(below + 1, values.size() - 1);
    return values[below] + (place - static_cast<double>(below)) * (values[above] - values[below]);
  };
  return {at((1 - confidence) / 2), at((1 + confidence) / 2)};
}

BootstrapResult bootstrap(const std::vector<StimulusCount>& counts, const Fit& fit, const FitOptions& how,
                          double background_n_m, const BootstrapOptions& options) {
  if (options.resamples < 20) throw std::invalid_argument("resamples: give at least 20");
  if (!(options.confidence > 0 && options.confidence < 1))
    throw std::invalid_argument("confidence: give a share between 0 and 1");
  if (!(background_n_m > 0)) throw std::invalid_argument("background_n_m: give a stiffness above zero");
  if (fit.at_limit)
    throw std::invalid_argument("the answers do not bound the curve: there is no interval to give");
  Random random(options.seed);
  std::vector<StimulusCount> drawn = counts;
  std::vector<double> alpha_n_m, beta, weber;
  BootstrapResult result;
  for (unsigned k = 0; k < options.resamples; ++k) {
    for (std::size_t i = 0; i < counts.size(); ++i) {
      const double p = probability_harder(fit.function, counts[i].stimulus_n_m);
      drawn[i].harder = 0;
      for (unsigned trial = 0; trial < counts[i].trials(); ++trial) drawn[i].harder += random.happens(p);
      drawn[i].not_harder = counts[i].trials() - drawn[i].harder;
    }
    const Fit again = fit_weibull_near(drawn, how, fit.function);
    alpha_n_m.push_back(again.function.alpha_n_m);
    beta.push_back(again.function.beta);
    weber.push_back(weber_fraction(again.function, background_n_m));
    result.at_limit += again.at_limit;
  }
  result.alpha_n_m = percentiles(std::move(alpha_n_m), options.confidence);
  result.beta = percentiles(std::move(beta), options.confidence);
  result.weber_fraction = percentiles(std::move(weber), options.confidence);
  return result;
}

}  // namespace teletact::client
