// A compliance by conjugate gradients in another way than the product's.
#pragma once

#include <memory>
#include <utility>

#include "service/tissue/iterative_compliance.h"
#include "service/tissue/tissue_model.h"

namespace teletact::service {

inline std::shared_ptr<Compliance> iterative_with(const ElasticitySolverOptions& options,
                                                  const TissueModel& model, std::size_t row,
                                                  const std::shared_ptr<Device>& device) {
  const TissueProblem& p = model.problem();
  auto solver =
      std::make_shared<SharedSolver>(device, p.grid, p.supports, p.material, options, MemoryAccount());
  return std::make_shared<IterativeCompliance>(std::move(solver), p.grid, p.material.poisson_ratio, row,
                                               p.touchable);
}

}  // namespace teletact::service
