// Compliance of one touched row (T4.2): displacement of its nodes under unit nodal forces on it, everything
// else condensed. Two ways give the same numbers: layer-by-layer elimination on the host (condensed, the fast
// path) and device PCG (columns on demand).
#pragma once

#include <Eigen/Core>
#include <chrono>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace teletact::service {

// Solver report of the solves behind some columns; the direct elimination reports zero iterations.
struct SolveReport {
  std::size_t iterations = 0;     // the most of any column
  double true_residual = 0;       // ||f - K u|| / ||f||, recomputed, the worst column
  double recursive_residual = 0;  // the solver's own recurrence
  // Of a compliance C: |C_ij error| <= relative_error sqrt(C_ii C_jj). Of a contact answer: what its force
  // may be off by because of that, over the force.
  double relative_error = 0;
  double of_model = 0;  // of that, what no solve makes less: the model is being made anew
  bool converged = true;
  bool improving = false;         // it is made better meanwhile: trusted up to choices::kTrustedMeanwhile
  const char* reason = "direct";  // why it stopped
};

// What is known of the error dC of a compliance in two forms left^T dC right.
struct FormError {
  // What rounding does to them, a few samples: C is computed again with other rounding, dC the difference.
  std::vector<Eigen::Vector2d> rounding;
  double largest_rounding = 0;  // of |dC_ij| / sqrt(C_ii C_jj) in these samples, root mean square
  // What iterations that were stopped leave of them, about.
  Eigen::Vector2d unfinished = Eigen::Vector2d::Zero();
};

// Thread-safe.
class Compliance {
 public:
  virtual ~Compliance() = default;
  // Compliance (m per N/m, plane strain: force per metre of thickness) among `nodes`, indices along the row
  // (grid columns i), strictly increasing. Rows and columns are ordered [u_x of node 0, u_y of node 0, u_x of
  // node 1, ...]; size 2n x 2n, symmetric positive definite. `report` may be null.
  // Throws std::out_of_range for a node that this compliance does not serve.
  virtual Eigen::MatrixXd among(std::span<const std::size_t> nodes, SolveReport* report) = 0;
  // Its axial part alone, [u_y of node 0, u_y of node 1, ...], n x n: all that frictionless contact asks for.
  virtual Eigen::MatrixXd axial_among(std::span<const std::size_t> nodes, SolveReport* report) = 0;
  // Displacement along y (m) of `at` under nodal forces [x, y] (N/m) on `loaded`, both as `nodes` above.
  virtual Eigen::VectorXd axial_under(std::span<const std::size_t> at, std::span<const std::size_t> loaded,
                                      const Eigen::Matrix2Xd& force_n_m);
  // Of left^T C right among `unknowns`, 2 column + component of each row. Empty where a provider has no
  // samples of it (condensed); then the bound of `report` is all there is.
  virtual std::optional<FormError> error_between(std::span<const std::size_t> /*unknowns*/,
                                                 const Eigen::MatrixX2d& /*left*/,
                                                 const Eigen::VectorXd& /*right*/) const {
    return {};
  }
  // Gets ready what the first two will be asked for among `nodes` (in any order, the first ones first), in
  // small steps of which none is begun after `until`; false when some is left. Columns that are ready stay
  // so: this boxes the time of a solve, and is how it is given up.
  virtual bool prepare(std::span<const std::size_t> /*nodes*/, bool /*tangential*/,
                       std::chrono::steady_clock::time_point /*until*/) {
    return true;
  }
};

}  // namespace teletact::service
