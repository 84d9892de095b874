#include "service/tissue/iterative_compliances.h"

#include <algorithm>
#include <cstdint>

#include "service/base/choices.h"

namespace teletact::service {

ElasticitySolverOptions iterative_options(const Device& device, double poisson_ratio) {
  ElasticitySolverOptions options;
  if (device.info().has_double) {
    options.precision = SolvePrecision::kDouble;
    options.relative_error = choices::kColumnError;
  } else if (poisson_ratio <= choices::kFloatPoissonRatio) {
    options.precision = SolvePrecision::kFloat;
  }
  return options;
}

std::shared_ptr<IterativeCompliance> IterativeCompliances::at(std::size_t row,
                                                              const std::shared_ptr<Device>& device) {
  const std::lock_guard making(making_);
  std::shared_ptr<SharedSolver> solver;
  {
    const std::lock_guard lock(mutex_);
    const auto found = kept_.find({row, device});
    if (found != kept_.end()) return found->second;
    solver = solvers_[device];
  }
  // Without the lock: to make one may take room, and compliances be given back for it.
  if (!solver) {
    solver = std::make_shared<SharedSolver>(device, problem_->grid, problem_->supports, problem_->material,
                                            iterative_options(*device, problem_->material.poisson_ratio),
                                            account_);
    account_.add(device->place(), solver);
  }
  auto made = std::make_shared<IterativeCompliance>(solver, problem_->grid, problem_->material.poisson_ratio,
                                                    row, problem_->touchable, account_);
  const std::lock_guard lock(mutex_);
  solvers_[device] = std::move(solver);
  kept_[{row, device}] = made;
  return made;
}

namespace {

// When what it would give back next was used last.
std::uint64_t oldest_of(const std::shared_ptr<IterativeCompliance>& one) {
  return one.use_count() == 1 && one->empty() ? one->used() : one->last_use();
}

}  // namespace

std::uint64_t IterativeCompliances::last_use() const {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  std::uint64_t oldest = UINT64_MAX;
  if (lock)
    for (const auto& [key, one] : kept_) oldest = std::min(oldest, oldest_of(one));
  return oldest;
}

bool IterativeCompliances::give_back() {
  std::shared_ptr<IterativeCompliance> gone;  // destroyed without the lock
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock || kept_.empty()) return false;
  const auto oldest = std::min_element(kept_.begin(), kept_.end(), [](const auto& a, const auto& b) {
    return oldest_of(a.second) < oldest_of(b.second);
  });
  if (oldest->second->give_back()) return true;
  if (oldest->second.use_count() > 1 || !oldest->second->empty()) return false;
  gone = std::move(oldest->second);
  kept_.erase(oldest);
  return true;
}

}  // namespace teletact::service
