// Parametric bootstrap (Efron; for psychometric functions Wichmann and Hill 2001): answers are drawn again
// from the fitted function, with the trials that there were, and fitted as the answers were.
#pragma once

#include <cstdint>
#include <vector>

#include "client/experiment/fit.h"

namespace teletact::client {

struct BootstrapOptions {
  unsigned resamples = 1000;  // >= 20
  double confidence = 0.95;   // in (0, 1)
  std::uint64_t seed = 1;
};

struct Interval {
  double low = 0, high = 0;
  bool contains(double value) const { return low <= value && value <= high; }
};

// Between which `confidence` of the values lie, as many below as above, interpolated between order
// statistics: number k of n lies at k / (n + 1), so that an interval of few values is not too narrow. Takes
// at least one.
Interval percentiles(std::vector<double> values, double confidence);

struct BootstrapResult {
  Interval alpha_n_m, beta, weber_fraction;  // of the percentiles
  unsigned at_limit = 0;                     // resamples whose fit ended at a limit (they count)
};

// Throws std::invalid_argument naming the field, and for a fit at a limit, whose resamples would all end
// there too: a narrow interval about nothing.
BootstrapResult bootstrap(const std::vector<StimulusCount>&, const Fit&, const FitOptions&,
                          double background_n_m, const BootstrapOptions& = {});

}  // namespace teletact::client
