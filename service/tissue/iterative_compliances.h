// The compliances of a problem's rows by conjugate gradients on devices: one solve per unit nodal force, when
// first asked for.
//
// With u_j the answer to the unit force f_j and r_j = f_j - K u_j its residual, C_ij is taken as
//   f_i . u_j + u_i . r_j,
// which is symmetric and off by -(e_i . K e_j) alone: by the product of two errors instead of one (T4.2b). A
// solve to 3e-4 in float thus gives compliances to about 1e-7. What is left is r_i . K^-1 r_j, about
// r_i . M r_j with the preconditioner M: these products say what a touch may be off by.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "service/base/memory.h"
#include "service/tissue/compliance.h"
#include "service/tissue/elasticity_solver.h"
#include "service/tissue/tissue_problem.h"

namespace teletact::service {

// The solver that the rows of a problem share on one device.
// Used by one thread at a time. It is made when it is
// needed and gives back the device's memory when others need it.
class SharedSolver final : public Reclaimable {
 public:
  // Makes the solver, and throws as its constructor does.
  SharedSolver(std::shared_ptr<Device> device, std::shared_ptr<const TissueProblem> problem,
               const ElasticitySolverOptions& options)
      : device_(std::move(device)),
        problem_(std::move(problem)),
        options_(options),
        charge_(options.account.charge(Place::kHost, "solvers", kBytes * problem_->grid.elements())) {
    make();
  }
  template <class Work>
  auto with(Work work) {
    const std::lock_guard lock(mutex_);
    const InUse use(busy_);
    used_ = use_stamp();
    if (!solver_) make();
    return work(*solver_);
  }
  std::uint64_t last_use() const override { return used_; }
  bool give_back() override {
    if (busy_) return false;  // first: the thread that uses it may be the one that needs room
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock || !solver_) return false;
    solver_.reset();
    return true;
  }

 private:
  static constexpr std::size_t kBytes = 32;  // of an element: grid, material and marks, on the host
  struct InUse {
    explicit InUse(std::atomic<bool>& busy_) : busy(busy_) { busy = true; }
    ~InUse() { busy = false; }
    std::atomic<bool>& busy;
  };
  void make() {
    const TissueProblem& p = *problem_;
    solver_ = std::make_unique<ElasticitySolver>(device_, p.grid, p.supports, p.material, options_);
  }

  const std::shared_ptr<Device> device_;
  const std::shared_ptr<const TissueProblem> problem_;
  const ElasticitySolverOptions options_;
  const Charge charge_;
  std::mutex mutex_;
  std::atomic<bool> busy_ = false;
  std::atomic<std::uint64_t> used_ = use_stamp();
  std::unique_ptr<ElasticitySolver> solver_;
};

// Of one row. Keeps 12 bytes per degree of freedom of the grid for every column asked for, as long as there
// is room: the column used least recently is given back first, and solved again when it is asked for again.
// What one call asks for is held together while it runs; where it does not fit the call throws MemoryRefused.
class IterativeCompliance final : public Compliance, public Reclaimable {
 public:
  IterativeCompliance(std::shared_ptr<SharedSolver>, const TissueProblem&, std::size_t row,
                      const MemoryAccount& = {});
  Eigen::MatrixXd among(std::span<const std::size_t> nodes, SolveReport* report) override;
  Eigen::MatrixXd axial_among(std::span<const std::size_t> nodes, SolveReport* report) override;
  // By the columns of what is loaded, off by their own error; no other is solved for it.
  Eigen::VectorXd axial_under(std::span<const std::size_t> at, std::span<const std::size_t> loaded,
                              const Eigen::Matrix2Xd& force_n_m) override;
  std::optional<FormError> error_between(std::span<const std::size_t> unknowns, const Eigen::MatrixX2d& left,
                                         const Eigen::VectorXd& right) const override;
  bool prepare(std::span<const std::size_t> nodes, bool tangential,
               std::chrono::steady_clock::time_point until) override;
  std::uint64_t last_use() const override;
  bool give_back() override;
  std::uint64_t used() const { return used_; }  // stamp of the last call
  bool empty() const { return solved_ == 0; }   // no column is kept

 private:
  // A unit force on one degree of freedom of the row.
  struct Column {
    bool solved = false;
    Eigen::VectorXd displacement;    // u, [dof of the grid]
    Eigen::VectorXf preconditioned;  // M r
    SolveReport report;
    Charge charge;
    std::uint64_t used = 0;  // stamp
    std::size_t asked = 0;   // by so many calls that run now
  };
  class Asked;
  struct Solved;
  Eigen::MatrixXd between(const std::vector<std::size_t>& unknowns, SolveReport* report);
  std::vector<std::size_t> next_missing(const std::vector<std::size_t>& unknowns, std::size_t& begin,
                                        std::size_t most) const;
  void get_ready(std::span<const std::size_t> unknowns);
  void solve_columns(const std::vector<std::size_t>& missing, std::vector<Charge>& room);
  std::vector<Column>::const_iterator oldest_unasked() const;
  void add_to_compliance(std::size_t unknown, const Solved&, std::size_t q);
  std::optional<Eigen::Vector2d> unfinished_between(std::span<const std::size_t> unknowns,
                                                    const Eigen::MatrixX2d& left,
                                                    const Eigen::VectorXd& right) const;
  std::size_t axial(std::size_t node) const { return 2 * position_among(node, touchable_) + 1; }  // unknown
  std::size_t grid_dof(std::size_t unknown) const { return first_dof_ + unknown; }

  const std::shared_ptr<SharedSolver> shared_;
  const MemoryAccount account_;
  const std::size_t dofs_, first_dof_;  // of the grid; of the first touchable node of the row
  const ColumnRange touchable_;
  const double rounding_bound_;  // of the relative error of any entry, made beforehand
  mutable std::mutex mutex_;     // not held while room is made: give_back() takes it
  std::atomic<std::uint64_t> used_ = use_stamp();
  std::atomic<std::size_t> solved_ = 0;
  double smallest_eigenvalue_ = 0;  // of M K
  std::vector<Column> columns_;     // by unknown: 2 (column - touchable.first) + component
  // Among the columns that are solved: C, r_i . M r_j, M r_i . K M r_j, samples of C's rounding.
  Eigen::MatrixXd compliance_;
  Eigen::MatrixXf unfinished_, step_energy_;
  std::vector<Eigen::MatrixXf> rounding_;
  Charge matrices_charge_;
};

// Of all rows, with one solver for each device. When others need room their columns are given back, and then
// what is left of those that nobody touches.
class IterativeCompliances final : public Reclaimable {
 public:
  IterativeCompliances(std::shared_ptr<const TissueProblem> problem, MemoryAccount account)
      : problem_(std::move(problem)), account_(std::move(account)) {}
  // That of the row, made if it is not kept; throws what making it throws.
  std::shared_ptr<Compliance> at(std::size_t row, const std::shared_ptr<Device>&);
  // That of the row if it is kept, else null.
  std::shared_ptr<Compliance> find(std::size_t row, const std::shared_ptr<Device>&) const;
  std::uint64_t last_use() const override;
  bool give_back() override;

 private:
  using Key = std::pair<std::size_t, std::shared_ptr<Device>>;
  const std::shared_ptr<const TissueProblem> problem_;
  const MemoryAccount account_;
  std::mutex making_;  // one at a time, with their solvers; not held by give_back()
  std::map<std::shared_ptr<Device>, std::shared_ptr<SharedSolver>> solvers_;
  mutable std::mutex mutex_;
  std::map<Key, std::shared_ptr<IterativeCompliance>> kept_;
};

// How they are solved: in double where the device has it, which costs what float does and converges from
// nu = 0 to .4999, contrasts of 1 to 1000 and elements up to 1:5; else in float up to nu = .495, refined
// beyond, which near nu = 1/2 and for stretched elements may stop short of what is asked, and says so.
ElasticitySolverOptions iterative_options(const Device&, double poisson_ratio);

}  // namespace teletact::service
