// Compliance of one line by conjugate gradients on a device: one solve per unit nodal force, when first asked
// for.
//
// With u_j the answer to the unit force f_j and r_j = f_j - K u_j its residual, C_ij is taken as
//   f_i . u_j + u_i . r_j,
// which is symmetric and off by -(e_i . K e_j) alone: by the product of two errors instead of one. A solve to
// 3e-4 in float thus gives compliances to about 1e-7. What is left is r_i . K^-1 r_j, about r_i . M r_j with
// the preconditioner M: these products say what a touch may be off by.
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "service/tissue/compliance.h"
#include "service/tissue/elasticity_solver.h"
#include "service/tissue/tissue_model.h"

namespace teletact::service {

// One solver for all lines of a model, used by one thread at a time.
struct SharedSolver {
  SharedSolver(const std::shared_ptr<Device>& device, const TissueGrid& grid, const Supports& supports,
               const Material& material, const ElasticitySolverOptions& options)
      : solver(device, grid, supports, options) {
    solver.set_material(material);
  }
  std::mutex mutex;
  ElasticitySolver solver;
};

// Keeps 12 bytes per degree of freedom of the grid for every column asked for.
class IterativeLine final : public Compliance {
 public:
  IterativeLine(std::shared_ptr<SharedSolver>, const TissueGrid&, double poisson_ratio, std::size_t line,
                ColumnRange touchable);
  Eigen::MatrixXd among(std::span<const std::size_t> nodes, SolveReport* report) override;
  Eigen::MatrixXd axial_among(std::span<const std::size_t> nodes, SolveReport* report) override;
  std::optional<FormError> error_between(std::span<const std::size_t> unknowns, const Eigen::MatrixX2d& left,
                                         const Eigen::VectorXd& right) const override;
  bool prepare(std::span<const std::size_t> nodes, bool tangential,
               std::chrono::steady_clock::time_point until) override;

 private:
  // A unit force on one degree of freedom of the line.
  struct Column {
    bool solved = false;
    Eigen::VectorXd displacement;   // u, [dof of the grid]
    Eigen::VectorXf nearly_solved;  // M r
    SolveReport report;
  };
  Eigen::MatrixXd between(const std::vector<std::size_t>& unknowns, SolveReport* report);
  void solve_missing(const std::vector<std::size_t>& unknowns);
  struct Solved;
  Solved solve(std::size_t count, const std::vector<double>& loads);
  void add_to_compliance(std::size_t unknown, std::span<const double> residual,
                         std::span<const double> step_force,
                         const std::vector<std::span<const double>>& rounding);
  std::optional<Eigen::Vector2d> unfinished_between(std::span<const std::size_t> unknowns,
                                                    const Eigen::MatrixX2d& left,
                                                    const Eigen::VectorXd& right) const;
  std::size_t grid_dof(std::size_t unknown) const { return first_dof_ + unknown; }

  std::shared_ptr<SharedSolver> shared_;
  std::size_t dofs_, first_dof_;  // of the grid; of the first touchable node of the line
  ColumnRange touchable_;
  double rounding_bound_;  // of the relative error of any entry, made beforehand
  mutable std::mutex mutex_;
  double smallest_eigenvalue_ = 0;  // of M K
  std::vector<Column> columns_;     // by unknown: 2 (column - touchable.first) + component
  // Among the columns that are solved: C, r_i . M r_j, M r_i . K M r_j, samples of C's rounding.
  Eigen::MatrixXd compliance_;
  Eigen::MatrixXf unfinished_, step_energy_;
  std::vector<Eigen::MatrixXf> rounding_;
};

}  // namespace teletact::service
