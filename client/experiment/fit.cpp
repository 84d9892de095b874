#include "client/experiment/fit.h"

#include <nlopt.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>

namespace teletact::client {
namespace {

constexpr double kThresholdReach = 10;  // beyond the outermost stimuli, as a factor
constexpr double kBetaMin = 0.05, kBetaMax = 200;
// Of the simplex, in the logarithms of the parameters.
constexpr double kTolerance = 1e-9, kNearTolerance = 1e-4, kFirstStep = 0.2, kNearFirstStep = 0.05;
constexpr double kAtLimit = 1e-3;  // of the parameters' logarithms
// A share of exactly 0 or 1 would have an infinite logarithm.
constexpr double kProbabilityMin = 1e-12;

struct Limits {
  double ln_threshold_min, ln_threshold_max, ln_beta_min, ln_beta_max, lapse_max;
};

Limits limits_of(const std::vector<StimulusCount>& counts, const FitOptions& options) {
  double least = std::numeric_limits<double>::infinity(), most = 0;
  for (const StimulusCount& count : counts) {
    least = std::min(least, count.stimulus_n_m);
    most = std::max(most, count.stimulus_n_m);
  }
  return {std::log(least / kThresholdReach), std::log(most * kThresholdReach), std::log(kBetaMin),
          std::log(kBetaMax), options.lapse_rate_max};
}

using Parameters = std::array<double, 3>;  // of the search: ln threshold, ln beta, lapse rate

// Parameters clamped into the limits.
struct Point {
  Weibull function;
  double outside = 0;  // distance from the limits
};

Point point_at(const Parameters& at, const Limits& limits) {
  const double ln_threshold = std::clamp(at[0], limits.ln_threshold_min, limits.ln_threshold_max);
  const double ln_beta = std::clamp(at[1], limits.ln_beta_min, limits.ln_beta_max);
  const double lapse = std::clamp(at[2], 0.0, limits.lapse_max);
  return {weibull_through(std::exp(ln_threshold), std::exp(ln_beta), lapse),
          std::abs(at[0] - ln_threshold) + std::abs(at[1] - ln_beta) + std::abs(at[2] - lapse)};
}

double cost_of(const std::vector<StimulusCount>& counts, FitMethod method, const Weibull& function) {
  double cost = 0;
  for (const StimulusCount& count : counts) {
    const double p = probability_harder(function, count.stimulus_n_m);
    if (method == FitMethod::kLeastSquares) {
      cost += (p - count.share_harder()) * (p - count.share_harder());
    } else {
      cost -= count.harder * std::log(std::max(p, kProbabilityMin)) +
              count.not_harder * std::log(std::max(1 - p, kProbabilityMin));
    }
  }
  return cost;
}

// The best of a coarse grid of thresholds and slopes.
Weibull coarse_search(const std::vector<StimulusCount>& counts, const FitOptions& options) {
  constexpr int kThresholds = 24;
  constexpr std::array<double, 7> kBetas{0.7, 1.5, 3, 6, 12, 24, 48};
  const Limits limits = limits_of(counts, options);
  Weibull best;
  double least = std::numeric_limits<double>::infinity();
  for (int k = 0; k <= kThresholds; ++k) {
    const double share = static_cast<double>(k) / kThresholds;
    const double threshold_n_m =
        std::exp(limits.ln_threshold_min + share * (limits.ln_threshold_max - limits.ln_threshold_min));
    for (const double beta : kBetas) {
      const Weibull function = weibull_through(threshold_n_m, beta, options.lapse_rate_max / 2);
      const double cost = cost_of(counts, options.method, function);
      if (!(cost < least)) continue;
      least = cost;
      best = function;
    }
  }
  return best;
}

// Never harder below one stimulus and always above it: such answers fit the better the steeper the curve, and
// from some slope on all alike.
bool steps(const std::vector<StimulusCount>& counts) {
  double last_not_harder = 0, first_harder = std::numeric_limits<double>::infinity();
  for (const StimulusCount& count : counts) {
    if (count.not_harder > 0) last_not_harder = std::max(last_not_harder, count.stimulus_n_m);
    if (count.harder > 0) first_harder = std::min(first_harder, count.stimulus_n_m);
  }
  return last_not_harder <= first_harder;
}

// Nelder and Mead's downhill simplex (Computer Journal 7, 1965): its first step and last width.
struct Simplex {
  double first_step, tolerance;
};

Fit descend(const std::vector<StimulusCount>& counts, const FitOptions& options, const Weibull& start,
            const Simplex& simplex) {
  constexpr int kMaxEvaluations = 2000;
  const Limits limits = limits_of(counts, options);
  auto cost = [&](unsigned dimensions, const double* at) {
    const Point point = point_at({at[0], at[1], dimensions > 2 ? at[2] : 0}, limits);
    return cost_of(counts, options.method, point.function) + point.outside;
  };
  const bool lapses = options.lapse_rate_max > 0;
  const std::unique_ptr<nlopt_opt_s, decltype(&nlopt_destroy)> search(
      nlopt_create(NLOPT_LN_NELDERMEAD, lapses ? 3 : 2), nlopt_destroy);
  nlopt_set_min_objective(
      search.get(),
      [](unsigned dimensions, const double* at, double*, void* of) {
        return (*static_cast<decltype(cost)*>(of))(dimensions, at);
      },
      &cost);
  nlopt_set_initial_step1(search.get(),
                          lapses ? std::min(simplex.first_step, options.lapse_rate_max) : simplex.first_step);
  nlopt_set_xtol_abs1(search.get(), simplex.tolerance);
  nlopt_set_maxeval(search.get(), kMaxEvaluations);
  Parameters at{std::log(threshold_n_m(start)), std::log(start.beta), start.lapse_rate};
  double least = 0;
  const nlopt_result ended = nlopt_optimize(search.get(), at.data(), &least);
  const Point point = point_at(at, limits);
  const double ln_threshold = std::log(threshold_n_m(point.function)),
               ln_beta = std::log(point.function.beta);
  Fit fit;
  fit.function = point.function;
  fit.cost = cost_of(counts, options.method, point.function);
  fit.converged = ended == NLOPT_XTOL_REACHED;
  fit.at_limit = steps(counts) || ln_threshold < limits.ln_threshold_min + kAtLimit ||
                 ln_threshold > limits.ln_threshold_max - kAtLimit ||
                 ln_beta < limits.ln_beta_min + kAtLimit || ln_beta > limits.ln_beta_max - kAtLimit;
  return fit;
}

// The stimuli that were presented.
std::vector<StimulusCount> presented(const std::vector<StimulusCount>& counts, const FitOptions& options) {
  if (!(options.lapse_rate_max >= 0 && options.lapse_rate_max <= 0.5))
    throw std::invalid_argument("lapse_rate_max: give a share from 0 to 0.5");
  if (options.lapse_rate_max > 0 && options.method == FitMethod::kLeastSquares)
    throw std::invalid_argument("lapse_rate_max: lapses are fitted by maximum likelihood alone");
  std::vector<StimulusCount> out;
  for (const StimulusCount& count : counts) {
    if (!(count.stimulus_n_m > 0) || !std::isfinite(count.stimulus_n_m))
      throw std::invalid_argument("stimulus_n_m: give stiffness above zero");
    if (count.trials() > 0) out.push_back(count);
  }
  if (out.size() < 2) throw std::invalid_argument("answers to at least two stimuli are needed for a fit");
  return out;
}

}  // namespace

const char* name_of(FitMethod method) {
  return method == FitMethod::kLeastSquares ? "least squares" : "maximum likelihood";
}

Fit fit_weibull(const std::vector<StimulusCount>& counts, const FitOptions& options) {
  const std::vector<StimulusCount> given = presented(counts, options);
  const auto all = [&](unsigned StimulusCount::*none) {
    return std::all_of(given.begin(), given.end(), [&](const StimulusCount& c) { return c.*none == 0; });
  };
  if (all(&StimulusCount::harder) || all(&StimulusCount::not_harder))
    throw std::invalid_argument("every answer is the same: there is no threshold among these stimuli");
  return descend(given, options, coarse_search(given, options), {kFirstStep, kTolerance});
}

Fit fit_weibull_near(const std::vector<StimulusCount>& counts, const FitOptions& options,
                     const Weibull& start) {
  return descend(presented(counts, options), options, start, {kNearFirstStep, kNearTolerance});
}

}  // namespace teletact::client
