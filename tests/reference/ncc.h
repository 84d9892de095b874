// Displacement estimation step by step in double precision and plain loops: what the kernels of search.cl and
// displacement.cl are held against. An image holds sample k of line l at [k + samples * l] and is zero
// outside.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <vector>

namespace teletact::reference {

struct RfImage {
  int samples = 0, lines = 0;
  std::vector<double> values;
  double at(int sample, int line) const {
    const bool inside = sample >= 0 && sample < samples && line >= 0 && line < lines;
    return inside ? values[static_cast<std::size_t>(sample) + static_cast<std::size_t>(samples) * line] : 0.0;
  }
};

// Window around a node: samples -half_axial .. half_axial every `stride`, lines -half_lateral ..
// half_lateral every `line_stride`, as far left as right.
struct Window {
  int half_axial = 0, half_lateral = 0, stride = 1, line_stride = 1;
};

// sum a b / sqrt(sum a^2 sum b^2) of pre around (sample, line) and post shifted by the lags (T2.1); 0 where
// either is silent.
double normalised_cross_correlation(const RfImage& pre, const RfImage& post, int sample, int line,
                                    const Window&, int axial_lag, int lateral_lag);

// Displacement of (sample, line), in lines and samples.
struct Shift {
  double lines = 0, samples = 0;
};

// Position of the largest correlation over all lags of both ranges (first, last), each coordinate refined by
// a parabola through the peak and its neighbours (biased, T2.2).
Shift ncc_peak(const RfImage& pre, const RfImage& post, int sample, int line, const Window&,
               const std::array<int, 2>& axial, const std::array<int, 2>& lateral);

// post(x + u(x)) at one sample: windowed sinc (Kaiser beta 5 over 8 samples or lines, unit sum) both
// ways; zero where the moved point lies outside the frame.
double interpolate(const RfImage& post, int sample, int line, const Shift& u);

}  // namespace teletact::reference
