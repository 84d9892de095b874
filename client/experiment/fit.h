// Fits of the psychometric function to counted answers (T6.4), both by Nelder and Mead's simplex over
// (ln threshold, ln beta).
#pragma once

#include <vector>

#include "client/experiment/trials.h"
#include "client/experiment/weibull.h"

namespace teletact::client {

enum class FitMethod {
  kLeastSquares,      // of the shares, every stimulus with the same weight: the paper's
  kMaximumLikelihood  // of the binomial counts
};
const char* name_of(FitMethod);

struct FitOptions {
  FitMethod method = FitMethod::kMaximumLikelihood;
  // Maximum likelihood alone: find the lapse rate too, from 0 to this. Zero: no lapses.
  double lapse_rate_max = 0;
};

struct Fit {
  Weibull function;
  double cost = 0;         // sum of squared differences of the shares, or -ln likelihood
  bool converged = false;  // of the simplex
  // The answers do not bound the threshold or the slope: they step from never to always harder with at most
  // one stimulus between, or do not rise, so that one of the two ends at or on its way to the limit of the
  // search (threshold within a tenth of the least to ten times the largest stimulus, beta within 0.05 to
  // 200).
  bool at_limit = false;
};

// Throws std::invalid_argument: fewer than two stimuli with trials, a stimulus not above zero,
// lapse_rate_max outside [0, 0.5] or given with least squares; answers all alike (nothing to fit).
Fit fit_weibull(const std::vector<StimulusCount>&, const FitOptions& = {});

// The same from a start that is near, as in a bootstrap: no search for one, and to 1e-4 of the threshold.
// Answers all alike are fitted too; they end at the limit.
Fit fit_weibull_near(const std::vector<StimulusCount>&, const FitOptions&, const Weibull& start);

}  // namespace teletact::client
