// A compliance by conjugate gradients in another way than the product's.
#pragma once

#include <memory>
#include <utility>

#include "service/tissue/iterative_compliances.h"
#include "service/tissue/tissue_model.h"

namespace teletact::service {

inline std::shared_ptr<Compliance> iterative_with(const ElasticitySolverOptions& options,
                                                  const TissueModel& model, std::size_t row,
                                                  const std::shared_ptr<Device>& device) {
  auto problem = std::make_shared<const TissueProblem>(model.problem());
  return std::make_shared<IterativeCompliance>(std::make_shared<SharedSolver>(device, problem, options),
                                               *problem, row);
}

}  // namespace teletact::service
