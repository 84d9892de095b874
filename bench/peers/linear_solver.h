// Other programs that solve K u = f for an assembled K, symmetric and positive definite, on one thread of the
// host.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <memory>
#include <string>

namespace teletact::bench {

class LinearSolver {
 public:
  virtual ~LinearSolver() = default;
  virtual std::string name() const = 0;
  virtual bool iterative() const = 0;
  // Throws std::domain_error.
  virtual void prepare(const Eigen::SparseMatrix<double>& k) = 0;
  // So many iterations, of one that iterates.
  virtual Eigen::VectorXd solve(const Eigen::VectorXd& f, int iterations) = 0;
};

// Null where it was not found when teletact was configured, and why in `absent`.
std::unique_ptr<LinearSolver> make_cholmod_factor(std::string& absent);
std::unique_ptr<LinearSolver> make_viennacl_multigrid(std::string& absent);

}  // namespace teletact::bench
