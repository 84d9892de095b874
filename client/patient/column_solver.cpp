#include "client/patient/column_solver.h"

#include <Eigen/Cholesky>
#include <stdexcept>

namespace teletact::client {

namespace {

using Triplets = std::vector<Eigen::Triplet<double>>;
using Index = Eigen::Index;

// Unit-modulus element matrices, one per row of elements.
std::vector<std::array<double, 64>> row_stiffness(const PatientMesh& mesh) {
  std::vector<std::array<double, 64>> rows;
  for (std::size_t j = 0; j + 1 < mesh.ny(); ++j)
    rows.push_back(
        element_stiffness(mesh.x_m[1] - mesh.x_m[0], mesh.y_m[j + 1] - mesh.y_m[j], mesh.poisson_ratio));
  return rows;
}

// The three blocks of element column i: added to A_i, to A_{i+1}, and C_i. Bottom unknowns are left out
// (fixed).
void assemble_column(const PatientMesh& mesh, const std::vector<std::array<double, 64>>& rows, std::size_t i,
                     Eigen::MatrixXd& left, Eigen::MatrixXd& right, Eigen::SparseMatrix<double>& coupling) {
  Triplets entries;
  for (std::size_t j = 0; j + 1 < mesh.ny(); ++j) {
    const double modulus = mesh.modulus(i, j);
    for (std::size_t a = 0; a < 8; ++a)
      for (std::size_t b = 0; b < 8; ++b) {
        const std::size_t node_a = a / 2, node_b = b / 2;  // (side, below) = (node % 2, node / 2)
        const std::size_t row = 2 * (j + node_a / 2) + a % 2, column = 2 * (j + node_b / 2) + b % 2;
        if (row >= 2 * (mesh.ny() - 1) || column >= 2 * (mesh.ny() - 1)) continue;
        const double value = modulus * rows[j][8 * a + b];
        const auto r = static_cast<Index>(row), c = static_cast<Index>(column);
        if (node_a % 2 == 0 && node_b % 2 == 0) left(r, c) += value;
        if (node_a % 2 == 1 && node_b % 2 == 1) right(r, c) += value;
        if (node_a % 2 == 0 && node_b % 2 == 1)
          entries.emplace_back(static_cast<int>(r), static_cast<int>(c), value);
      }
  }
  coupling.setFromTriplets(entries.begin(), entries.end());
}

constexpr Index kSurfaceY = 1;  // u_y of a column's surface node

}  // namespace

ColumnSolver::ColumnSolver(const PatientMesh& mesh) : nx_(mesh.nx()), ny_(mesh.ny()) {
  const auto n = static_cast<Index>(2 * (ny_ - 1));
  const auto rows = row_stiffness(mesh);
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(n, n);
  Eigen::MatrixXd diagonal = Eigen::MatrixXd::Zero(n, n);
  for (std::size_t i = 0; i < nx_; ++i) {
    Eigen::MatrixXd next = Eigen::MatrixXd::Zero(n, n);
    if (i + 1 < nx_) {
      coupling_.emplace_back(n, n);
      assemble_column(mesh, rows, i, diagonal, next, coupling_.back());
    }
    const Eigen::LLT<Eigen::MatrixXd> factor(diagonal);
    if (factor.info() != Eigen::Success)
      throw std::runtime_error("the patient's stiffness is not positive definite");
    inverse_.push_back(factor.solve(identity));
    // D_{i+1} = A_{i+1} - C_i^T P_i C_i
    if (i + 1 < nx_) {
      const Eigen::MatrixXd carried = inverse_.back() * coupling_.back();
      diagonal = next - coupling_.back().transpose() * carried;
    }
  }
}

std::vector<double> ColumnSolver::displacement(const Eigen::VectorXd& f_y) const {
  if (f_y.size() != static_cast<Index>(nx_))
    throw std::invalid_argument("one surface force per column of nodes");
  const auto n = static_cast<Index>(2 * (ny_ - 1));
  // Forward: z_i = P_i (f_i - C_{i-1}^T z_{i-1})
  std::vector<Eigen::VectorXd> z(nx_);
  for (std::size_t i = 0; i < nx_; ++i) {
    Eigen::VectorXd f = Eigen::VectorXd::Zero(n);
    f(kSurfaceY) = f_y(static_cast<Index>(i));
    if (i > 0) f -= coupling_[i - 1].transpose() * z[i - 1];
    z[i] = inverse_[i] * f;
  }
  // Back: u_i = z_i - P_i C_i u_{i+1}
  for (std::size_t i = nx_ - 1; i-- > 0;) {
    const Eigen::VectorXd carried = coupling_[i] * z[i + 1];
    z[i] -= inverse_[i] * carried;
  }
  std::vector<double> u(2 * nx_ * ny_, 0.0);
  for (std::size_t i = 0; i < nx_; ++i) Eigen::Map<Eigen::VectorXd>(u.data() + 2 * ny_ * i, n) = z[i];
  return u;
}

Eigen::MatrixXd ColumnSolver::surface_compliance() const {
  const auto n = static_cast<Index>(2 * (ny_ - 1)), columns = static_cast<Index>(nx_);
  Eigen::MatrixXd compliance(columns, columns);
  // From right to left: `inverse` is the diagonal block (K^-1)_ii, column k of `u` is u_i under a unit force
  // on surface node k >= i:  (K^-1)_ii = P_i + P_i C_i (K^-1)_{i+1,i+1} C_i^T P_i,  u_i = -P_i C_i u_{i+1}.
  Eigen::MatrixXd inverse = inverse_.back(), u = Eigen::MatrixXd::Zero(n, columns), carried(n, columns);
  for (Index i = columns - 1; i >= 0; --i) {
    const Index right = columns - 1 - i;
    if (right > 0) {
      const auto at = static_cast<std::size_t>(i);
      const Eigen::MatrixXd& p = inverse_[at];
      carried.rightCols(right) = coupling_[at] * u.rightCols(right);
      u.rightCols(right).noalias() = -p * carried.rightCols(right);
      const Eigen::MatrixXd half = coupling_[at] * inverse;
      const Eigen::MatrixXd inner = half * coupling_[at].transpose();
      inverse = p;
      inverse.noalias() += p * (inner * p);
    }
    u.col(i) = inverse.col(kSurfaceY);
    compliance.row(i).tail(right + 1) = u.row(kSurfaceY).tail(right + 1);
  }
  compliance.triangularView<Eigen::StrictlyLower>() = compliance.transpose();
  return compliance;
}

}  // namespace teletact::client
