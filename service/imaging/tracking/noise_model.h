// Second-order statistics of a motion-compensated pair (T2.3b): how much displacement information its pixels
// hold, and the filter that gets the most out of them.
//
// mean = (pre + warped post) / 2 and difference = pre - warped post are uncorrelated when both frames carry
// the same noise; the difference is all noise, the mean holds the common signal and half of the noise's
// power.
#pragma once

#include <array>
#include <vector>

namespace teletact::service {

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
