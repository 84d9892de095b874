// The psychometric function (T6.4): how likely a stiffness is judged harder than the background's.
//
//   p0(s) = 1 - 2^{-(s/alpha)^beta},   p(s) = lapse/2 + (1 - lapse) p0(s)
//
// alpha is the stiffness at p0 = 1/2 (the point of subjective equality), beta the slope. Who lapses did not
// attend and answers by chance. Threshold and Weber fraction are those of p0: of the sense, not of attention.
#pragma once

namespace teletact::client {

constexpr double kThresholdProbability = 0.75;  // p0 at the threshold

struct Weibull {
  double alpha_n_m = 0;   // > 0
  double beta = 0;        // > 0
  double lapse_rate = 0;  // 0 <= lapse < 1
};

// p(s); s >= 0 N/m.
double probability_harder(const Weibull&, double stimulus_n_m);

// The stiffness at p0 = 0.75: alpha 2^{1/beta}.
double threshold_n_m(const Weibull&);

// The function with this threshold (p0 = 0.75) and slope.
Weibull weibull_through(double threshold_n_m, double beta, double lapse_rate = 0);

// (threshold - background) / background.
double weber_fraction(const Weibull&, double background_n_m);

// Somebody whose Weber fraction is known.
struct ObserverDescription {
  double weber_fraction = 0.2;  // > 0, by the definition above
  double lapse_rate = 0;        // 0 <= lapse < 1
  // Where "harder" and "softer" are equally likely, as a fraction of the background above it; 0: no bias.
  // Less than the Weber fraction. (The paper's persons: 0.30 and 0.08.)
  double equality_fraction = 0;
};

// The one psychometric function of that description: p0 = 1/2 at background (1 + equality) and 3/4 at
// background (1 + Weber fraction), so beta = ln 2 / ln((1 + Weber) / (1 + equality)).
// Throws std::invalid_argument naming the field.
Weibull psychometric_function(const ObserverDescription&, double background_n_m);

}  // namespace teletact::client
