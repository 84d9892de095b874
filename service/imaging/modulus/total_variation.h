// Total variation of one value per element of a tissue grid, smoothed (T3.3), and its lagged-diffusivity
// matrix (Vogel and Oman 1996): TV = sum_e |e| sqrt(|grad v|^2 + floor^2), grad by differences to the right
// and below; near v, TV ~ v^T L(v) v / 2. Each edge costs by its height, which lowers lumps; with a finite
// `edge_per_m`, what is steeper than that costs by ln of its height.
#pragma once

#include <Eigen/SparseCore>
#include <limits>
#include <vector>

#include "service/tissue/grid.h"

namespace teletact::service {

inline constexpr double kTvPerM =
    5000;  // alpha: what a metre of a unit jump costs, in half squares of the data
inline constexpr double kTvFloorPerM = 50;  // gradient below which the variation is quadratic

class TotalVariation {
 public:
  explicit TotalVariation(const TissueGrid&);
  // Less that of a constant.
  double value(const Eigen::VectorXd& v, double edge_per_m = std::numeric_limits<double>::infinity()) const;
  Eigen::SparseMatrix<double> lagged(const Eigen::VectorXd& v,
                                     double edge_per_m = std::numeric_limits<double>::infinity()) const;

 private:
  struct Gradient {
    double right = 0, below = 0, size = 0;  // size: sqrt(|grad|^2 + floor^2)
  };
  Gradient gradient(const Eigen::VectorXd& v, std::size_t i, std::size_t j) const;
  double area(std::size_t i, std::size_t j) const;
  const TissueGrid& grid_;
  std::size_t nx_, ny_;                      // elements
  std::vector<double> to_right_, to_below_;  // distances of centres; 0 after the last
};

}  // namespace teletact::service
