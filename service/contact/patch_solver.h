// The smooth contact of a patch: Newton's method on a strictly concave energy.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "service/contact/patch_factor.h"
#include "service/contact/skin.h"

namespace teletact::service {

// max over p of p^T w - 1/2 p^T A p + sum of W(p_i) over the last unknowns, those of the nodes: p_i >= 0
// there, each under its skin. The unknowns before them are free.
struct PatchProgramme {
  Eigen::MatrixXd a;  // symmetric positive definite
  Eigen::VectorXd w;
  std::vector<double> stiffness, thickness_m;  // of the skin, per node
  Eigen::Index first_node() const { return w.size() - Eigen::Index(stiffness.size()); }
};

struct PatchSolution {
  Eigen::VectorXd p;                 // 0 where a node does not touch
  std::vector<Eigen::Index> active;  // the free unknowns, and the nodes that touch
  std::vector<SkinState> skin;       // per node; meaningful where it touches
  PatchFactor factor;                // of A + D over `active`, D the compliance of the skins
  std::size_t iterations = 0;
};

// About what a round tip is pressed by, scaled to the most energy along it. `edge`: the overlap over the
// indentation where contact ends on homogeneous tissue.
Eigen::VectorXd first_guess(const PatchProgramme&, double indentation_m, double edge);

// `guess`: p to start from, >= 0 for nodes; any gives the same, unique answer. Throws std::domain_error when
// A is not positive definite or the iteration does not settle.
PatchSolution solve_patch(const PatchProgramme&, Eigen::VectorXd guess);

}  // namespace teletact::service
