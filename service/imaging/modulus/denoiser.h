// What total variation makes of ln E as each cell of a solid tells it: one step of the method (T3.6).
#pragma once

#include <Eigen/Core>
#include <vector>

#include "service/imaging/modulus/probed_tissue.h"
#include "service/imaging/modulus/sparse_factor.h"
#include "service/imaging/modulus/total_variation.h"

namespace teletact::service {

// Towards the least of |W^(1/2) (v - observed)|^2 / 2 + alpha TV(v) (T3.6), W the weights of the cells.
class Denoiser {
 public:
  explicit Denoiser(const CellGrid&);
  // From `v` on, by one step of lagged diffusivity. With five, each step of the method takes a third longer,
  // and it ends up to two steps later.
  Eigen::VectorXd operator()(const Eigen::VectorXd& observed, const Eigen::VectorXd& weight,
                             const Eigen::VectorXd& v);
  // - ln of how likely v is, but for a constant, where it leaves `left` of what is observed.
  double cost(const Eigen::VectorXd& left, const Eigen::VectorXd& weight, const Eigen::VectorXd& v) const;
  // Standard deviation about v.
  Eigen::VectorXd deviation(const Eigen::VectorXd& weight, const Eigen::VectorXd& v);

 private:
  void factorize(const Eigen::VectorXd& weight, const Eigen::VectorXd& v);
  TissueGrid grid_;
  TotalVariation variation_;
  std::vector<int> order_;
  SparseFactor factor_;
};

}  // namespace teletact::service
