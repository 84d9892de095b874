// The smooth contact of a patch: Newton's method on a strictly concave energy.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <cstddef>
#include <vector>

#include "service/contact/fingertip.h"

namespace teletact::service {

// Cholesky factor of the small matrices of a contact patch. Up to 32 rows it works on sizes that the compiler
// knows, several times faster than a general one; Eigen's takes the larger.
class PatchFactor {
 public:
  // Factors a symmetric matrix (its lower triangle is read) and replaces b by the solution. Throws
  // std::domain_error when the matrix is not positive definite.
  void factor_and_solve(const Eigen::MatrixXd&, Eigen::Ref<Eigen::VectorXd> b);
  // Replaces b by the solution with the last factor.
  void solve(Eigen::Ref<Eigen::VectorXd> b) const;

 private:
  static constexpr int kBlock = 8, kSmall = 32;
  using Column = Eigen::Matrix<double, kSmall, 1>;
  template <int Rows>
  bool factor(const Eigen::MatrixXd&, Column& b);
  void substitute_back(Column& b) const;

  Eigen::Index size_ = 0;
  // A = L D L^T: columns of L, zeros above the unit diagonal and below the last row; D.
  Eigen::Matrix<double, kSmall, kSmall> l_;
  Column pivots_;
  Eigen::LLT<Eigen::MatrixXd> large_;
};

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
