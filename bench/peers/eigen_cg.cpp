// Eigen's conjugate gradients with Jacobi and with its incomplete Cholesky factor (shifted until it exists),
// on one thread. `tolerance` is its own: the residual over that of the right-hand side.
#include <fmt/format.h>

#include <Eigen/IterativeLinearSolvers>
#include <algorithm>
#include <array>
#include <optional>
#include <stdexcept>

#include "bench/peers/peer.h"
#include "bench/peers/prescribed.h"

namespace teletact::bench {
namespace {

constexpr Eigen::Index kMostIterations = 40000;

template <class Preconditioner, int kOrder>
class EigenCg final : public Peer {
 public:
  EigenCg(std::string name, std::size_t most_dofs) : name_(std::move(name)), most_dofs_(most_dofs) {}
  std::string name() const override { return name_; }
  bool iterative() const override { return true; }
  std::string declines(const ContactProblem& p) const override {
    return p.tissue.grid.dofs() <= most_dofs_
               ? std::string()
               : fmt::format("more than {} unknowns would take minutes", most_dofs_);
  }
  double prepare(const ContactProblem& p) override {
    if (of_ != describe(p.of)) {  // the matrix is given to a rival: not timed twice
      system_.emplace(p);
      matrix_ = system_->matrix;
      of_ = describe(p.of);
      shift_ = kShifts.front();
    }
    solver_ = std::make_unique<Solver>();
    solver_->setMaxIterations(kMostIterations);
    solver_->compute(matrix_);
    if (solver_->info() != Eigen::Success) throw std::domain_error(name_ + ": the preconditioner broke down");
    return -1;
  }
  PeerAnswer touch(const ContactProblem& p, double tolerance) override {
    solver_->setTolerance(tolerance);
    const Eigen::VectorXd solution = solver_->solve(system_->right);
    PeerAnswer answer;
    answer.iterations = static_cast<std::size_t>(solver_->iterations());
    answer.displacement_m = system_->displacement_m(p, solution);
    answer.force_n = PrescribedContact::force_n(p, answer.displacement_m);
    return answer;
  }

 private:
  using Matrix = Eigen::SparseMatrix<double, kOrder>;
  using Solver = Eigen::ConjugateGradient<Matrix, Eigen::Lower | Eigen::Upper, Preconditioner>;
  bool compute(double shift) {
    solver_ = std::make_unique<Solver>();
    solver_->setMaxIterations(kMostIterations);
    if constexpr (requires { solver_->preconditioner().setInitialShift(shift); })
      solver_->preconditioner().setInitialShift(shift);
    solver_->compute(matrix_);
    return solver_->info() == Eigen::Success;
  }

  static constexpr std::array kShifts{1e-3, 1e-2, 0.1, 0.3, 1.0};
  std::string name_, of_;
  std::size_t most_dofs_;
  double shift_ = kShifts.front();
  std::optional<PrescribedContact> system_;
  Matrix matrix_;
  std::unique_ptr<Solver> solver_;
};

}  // namespace

std::unique_ptr<Peer> make_eigen_cg_jacobi() {
  constexpr std::size_t kMostDofs = 30000;
  using Jacobi = Eigen::DiagonalPreconditioner<double>;
  return std::make_unique<EigenCg<Jacobi, Eigen::RowMajor>>("Eigen CG, Jacobi", kMostDofs);
}

std::unique_ptr<Peer> make_eigen_cg_incomplete_cholesky() {
  constexpr std::size_t kMostDofs = 200000;
  using Incomplete = Eigen::IncompleteCholesky<double, Eigen::Lower, Eigen::NaturalOrdering<int>>;
  return std::make_unique<EigenCg<Incomplete, Eigen::ColMajor>>("Eigen CG, incomplete Cholesky", kMostDofs);
}

}  // namespace teletact::bench
