// The solver that the rows of a problem share on one device.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <utility>

#include "service/base/memory.h"
#include "service/tissue/elasticity_solver.h"
#include "service/tissue/tissue_problem.h"

namespace teletact::service {

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

}  // namespace teletact::service
