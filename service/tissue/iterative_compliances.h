// The compliances of a problem by conjugate gradients, with one solver for each device. When others need room
// their columns are given back, and then what is left of those that nobody touches.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <utility>

#include "service/tissue/iterative_compliance.h"
#include "service/tissue/tissue_problem.h"

namespace teletact::service {

class IterativeCompliances final : public Reclaimable {
 public:
  IterativeCompliances(std::shared_ptr<const TissueProblem> problem, MemoryAccount account)
      : problem_(std::move(problem)), account_(std::move(account)) {}
  // That of the row, made if it is not kept; throws what making it throws.
  std::shared_ptr<IterativeCompliance> at(std::size_t row, const std::shared_ptr<Device>&);
  std::uint64_t last_use() const override;
  bool give_back() override;

 private:
  using Key = std::pair<std::size_t, std::shared_ptr<Device>>;
  const std::shared_ptr<const TissueProblem> problem_;
  const MemoryAccount account_;
  std::mutex making_;         // one at a time; not held by give_back()
  mutable std::mutex mutex_;  // of the maps
  std::map<std::shared_ptr<Device>, std::shared_ptr<SharedSolver>> solvers_;
  std::map<Key, std::shared_ptr<IterativeCompliance>> kept_;
};

// How they are solved: in double where the device has it, which costs what float does and converges from
// nu = 0 to .4999, contrasts of 1 to 1000 and elements up to 1:5; else in float up to nu = .495, refined
// beyond, which near nu = 1/2 and for stretched elements may stop short of what is asked, and says so.
ElasticitySolverOptions iterative_options(const Device&, double poisson_ratio);

}  // namespace teletact::service
