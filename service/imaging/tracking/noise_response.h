// How the noise of a displacement estimate and of what is computed from it follows from the information that
// the pixels hold (T2.3c): local Fourier analysis. The estimator is taken for a filter with the wave-number
// response T(k) of a place where everything is as it is here, so that a linear functional with response S(k)
// has the variance
//   1 / (2 pi)^2  Int |S T|^2 / (h m) dk,
// h the information of a node (1 / variance), m(k) the share of it that hat functions leave at wave number k
// (neighbouring nodes share pixels). Wave numbers in radians per node. No boundary: a node at the border
// has up to twice the variance.
#pragma once

#include <array>
#include <functional>
#include <vector>

namespace teletact::service {

// Squared response at (along, down), both in [0, pi].
using Response = std::function<double(double along, double down)>;

// Regularised estimate after `steps` Gauss-Newton steps; weights of the edges as refinement.h.
struct SmootherResponse {
  double weight_along = 0, weight_down = 0;
  int gradient_radius = 0, steps = 1;
};

// Standard deviation at the information median * 2^(n - kBelowMedian), n = 0 .. 31.
using DeviationTable = std::array<float, 32>;
inline constexpr int kBelowMedian = 20;

class NoiseResponse {
 public:
  NoiseResponse() = default;
  // median: information that the tables are centred on; line_step, sample_step: of the hat functions.
  NoiseResponse(const SmootherResponse&, double median, int line_step, int sample_step);
  // The functional with squared response `squared`.
  DeviationTable table(const Response& squared) const;
  // The bias that the smoother's edges show, their pull over the information, averaged over (2 radius +
  // 1)^2 nodes: its deviation by noise alone; and what the bias truly is over what is seen so, root mean
  // square for a jump of strain across a curve (power of the displacement ~ k^-5). Zeros without edges.
  DeviationTable bias_noise(int radius) const;
  DeviationTable bias_over_seen(int radius) const;
  double median() const { return median_; }

 private:
  double median_ = 1;
  std::vector<double> power_;        // |T|^2 / (h m) of every entry and wave number
  std::vector<double> lost_, seen_;  // 1 - T; T times the edges' force over h
};

// Squared response of the slopes that a least-squares plane over (2 half_columns + 1) x (2 half_rows + 1)
// nodes finds: along = true d/di, else d/dj, per node step.
Response plane_slope(int half_columns, int half_rows, bool along);

}  // namespace teletact::service
