// Second-order statistics of a motion-compensated pair (T2.3b): how much displacement information its pixels
// hold, and the filter that gets the most out of them.
//
// mean = (pre + warped post) / 2 and difference = pre - warped post are uncorrelated when both frames carry
// the same noise; the difference is all noise, the mean holds the common signal and half of the noise's
// power.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

namespace teletact::service {

// How the noise of a displacement estimate and of what is computed from it follows from the information that
// the pixels hold (T2.3c): local Fourier analysis. The estimator is taken for a filter with the wave-number
// response T(k) of a place where everything is as it is here, so that a linear functional with response S(k)
// has the variance
//   1 / (2 pi)^2  Int |S T|^2 / (h m) dk,
// h the information of a node (1 / variance), m(k) the share of it that hat functions leave at wave number k
// (neighbouring nodes share pixels). Wave numbers in radians per node. No boundary: a node at the border
// has up to twice the variance.

// Regularised estimate after `steps` Gauss-Newton steps; weights of the edges as refinement.h.
struct SmootherResponse {
  double weight_along = 0, weight_down = 0;
  int gradient_radius = 0, steps = 1;
};

// Standard deviation at the information median * 2^(n - kBelowMedian), n = 0 .. 31.
using DeviationTable = std::array<float, 32>;
inline constexpr int kBelowMedian = 20;

inline constexpr int kWaves = 32;  // along and down each, midpoints of [0, pi]
using Waves = Eigen::Array<double, kWaves, kWaves>;

class NoiseResponse {
 public:
  NoiseResponse() = default;
  // median: information that the tables are centred on; line_step, sample_step: of the hat functions.
  NoiseResponse(const SmootherResponse&, double median, int line_step, int sample_step);
  DeviationTable deviation() const;
  // Of the slopes that a least-squares plane over (2 half_columns + 1) x (2 half_rows + 1) nodes finds: along
  // = true d/di, else d/dj, per node step.
  DeviationTable slope(int half_columns, int half_rows, bool along) const;
  // Of such a slope less its own mean over that kernel, a parabola along it and a box across, as the plane
  // weighs the slopes within (T2.4).
  DeviationTable slope_rest(int half_columns, int half_rows, bool along) const;
  // The bias that the smoother's edges show, their pull over the information, averaged over (2 radius +
  // 1)^2 nodes: its deviation by noise alone; and what the bias truly is over what is seen so, root mean
  // square for a jump of strain across a curve (power of the displacement ~ k^-5). Zeros without edges.
  DeviationTable bias_noise(int radius) const;
  DeviationTable bias_over_seen(int radius) const;
  // The same of a slope: what it is off by for such a jump, smoothing included, over what slope_rest() sees.
  DeviationTable slope_bias_over_seen(int half_columns, int half_rows, bool along) const;
  double median() const { return median_; }

 private:
  struct Entry {
    double information;
    Waves passed;  // T
  };
  DeviationTable over_entries(auto&& of) const;
  DeviationTable table(const Waves& squared_response) const;
  double median_ = 1;
  Waves shares_, edges_;  // m; the force of the edges
  std::vector<Entry> entries_;
};

// r(lag, lateral) per pixel, [lateral][lag], axial lags 0 .. lags - 1, lateral lags 0 .. laterals - 1.
struct Autocorrelations {
  int lags = 0, laterals = 0;
  std::vector<double> mean, difference;
};

// Lateral [0] and axial [1].
struct NoiseModel {
  // Sum over all lags of rho_gradient rho_difference: neighbouring pixels' noise is alike (decorrelation has
  // the speckle's own spectrum), so that n pixels hold only n / spread of white noise's information.
  std::array<double, 2> spread{1, 1};
  // Part of the gradient's power that belongs to the common signal; the rest is noise in the mean.
  std::array<double, 2> sensitivity{1, 1};
};

NoiseModel noise_model(const Autocorrelations&);

// Taps 0 .. reach of symmetric filters along and across the A-lines.
struct MatchedFilter {
  std::vector<float> axial, lateral;
};

// The filters whose output tracks best: the maximum-likelihood processor of Knapp and Carter (1976, doi
// 10.1109/TASSP.1976.1162830) with measured spectra, one direction after the other. With P and Q the spectra
// of mean and difference / 2 the squared gain is 1 / Q - 1 / P: white noise where the signal is, nothing
// where there is none or where the interpolation fails. Unit gain at the peak.
MatchedFilter matched_filter(const Autocorrelations&, int axial_reach, int lateral_reach);

}  // namespace teletact::service
