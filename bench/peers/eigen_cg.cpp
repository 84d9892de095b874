// Eigen's conjugate gradients on one thread with Jacobi, with its incomplete Cholesky factor (shifted until
// it exists), and with the factor of K for a uniform modulus (T4.6), which is what knowing the problem adds
// to it. `tolerance` is its own: the residual over that of the right-hand side.
#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "bench/peers/peer.h"
#include "bench/peers/prescribed.h"

namespace teletact::bench {
namespace {

constexpr Eigen::Index kMaxIterations = 40000;

// Of a uniform modulus: it depends on the grid, nu and what is held, not on the tissue, and is no set-up.
class UniformFactor {
 public:
  void set(std::shared_ptr<const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>> factor) {
    factor_ = std::move(factor);
  }
  template <class Matrix>
  UniformFactor& compute(const Matrix&) {
    return *this;
  }
  Eigen::VectorXd solve(const Eigen::VectorXd& r) const { return factor_->solve(r); }
  Eigen::ComputationInfo info() const { return Eigen::Success; }

 private:
  std::shared_ptr<const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>> factor_;
};

template <class Preconditioner, int kOrder>
class EigenCg final : public Peer {
 public:
  EigenCg(std::string name, std::size_t max_dofs) : name_(std::move(name)), max_dofs_(max_dofs) {}
  std::string name() const override { return name_; }
  bool iterative() const override { return true; }
  std::size_t max_unknowns() const override { return max_dofs_; }
  double prepare(const ContactProblem& p) override {
    if (of_ != describe(p.of)) {  // the matrix is given to a rival: not timed twice
      system_.emplace(p);
      matrix_ = system_->matrix;
      of_ = describe(p.of);
      if constexpr (std::is_same_v<Preconditioner, UniformFactor>)
        factor_ = std::make_shared<Factor>(system_->uniform(p));
      shift_ = std::find_if(kShifts.begin(), kShifts.end(), [&](double shift) { return compute(shift); });
    }
    if (shift_ == kShifts.end() || !compute(*shift_))
      throw std::domain_error(name_ + ": the preconditioner broke down");
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
  using Factor = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>;
  using Solver = Eigen::ConjugateGradient<Matrix, Eigen::Lower | Eigen::Upper, Preconditioner>;
  bool compute(double shift) {
    solver_ = std::make_unique<Solver>();
    solver_->setMaxIterations(kMaxIterations);
    if constexpr (requires { solver_->preconditioner().setInitialShift(shift); })
      solver_->preconditioner().setInitialShift(shift);
    if constexpr (std::is_same_v<Preconditioner, UniformFactor>) solver_->preconditioner().set(factor_);
    solver_->compute(matrix_);
    return solver_->info() == Eigen::Success;
  }

  static constexpr std::array kShifts{1e-3, 1e-2, 0.1, 0.3, 1.0};
  std::string name_, of_;
  std::size_t max_dofs_;
  std::array<double, 5>::const_iterator shift_ = kShifts.end();
  std::optional<PrescribedContact> system_;
  Matrix matrix_;
  std::unique_ptr<Solver> solver_;
  std::shared_ptr<const Factor> factor_;
};

}  // namespace

std::unique_ptr<Peer> make_eigen_cg_jacobi() {
  constexpr std::size_t kMaxDofs = 30000;
  using Jacobi = Eigen::DiagonalPreconditioner<double>;
  return std::make_unique<EigenCg<Jacobi, Eigen::RowMajor>>("Eigen CG, Jacobi", kMaxDofs);
}

std::unique_ptr<Peer> make_eigen_cg_incomplete_cholesky() {
  constexpr std::size_t kMaxDofs = 30000;
  using Incomplete = Eigen::IncompleteCholesky<double, Eigen::Lower, Eigen::NaturalOrdering<int>>;
  return std::make_unique<EigenCg<Incomplete, Eigen::ColMajor>>("Eigen CG, incomplete Cholesky", kMaxDofs);
}

std::unique_ptr<Peer> make_eigen_cg_uniform_factor() {
  constexpr std::size_t kMaxDofs = 200000;
  return std::make_unique<EigenCg<UniformFactor, Eigen::RowMajor>>(
      "CG with the factor of a uniform modulus (T4.6)", kMaxDofs);
}

}  // namespace teletact::bench
