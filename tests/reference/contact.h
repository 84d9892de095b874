// Contact of a fingertip in displacement form, by the KKT system (T4.1): a node tip prescribes B u = w; under
// a punch or a rounded tip the energy
//   U(pose) = min over u of  1/2 u^T K u + 1/2 sum_i k_i(w_i) u_x,i^2 + sum_i V(u_y,i - w_i)
// with the springs k_i of the stuck contact and the tip's skin V is minimised first, and the gaps that it
// leaves are what is prescribed. Nothing is shared with the product but the plain structs: the product
// maximises the dual of this over a condensed compliance.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "service/contact/contact.h"  // the plain structs alone: fingertip and pose

namespace teletact::reference {

enum class KktMethod {
  kDense,         // the whole KKT matrix by Gaussian elimination (T4.1), once the active set is known
  kSparseFactor,  // B K^-1 B^T from a sparse factor (T4.2)
};

struct TouchedTissue {
  service::TissueGrid grid;
  service::Material material;
  service::Supports supports;
  std::size_t line = 0;
  double thickness_m = 0.010;
};

struct ContactSolution {
  std::array<double, 2> force_n{};  // on the finger: -dU/dpose
  double energy_j = 0;
  std::vector<std::size_t> columns;  // columns of the line in contact (the footprint of a node tip)
  Eigen::VectorXd multiplier_n_m;    // T4.1's lambda, one per constraint, < 0 pushes the tissue
  Eigen::VectorXd displacement_m;
};

// Any node of the line may touch. Throws std::logic_error when the multipliers of the final KKT solution are
// not what the skins bear.
ContactSolution touch(const TouchedTissue&, const service::Fingertip&, const service::PlanePose&, KktMethod);

}  // namespace teletact::reference
