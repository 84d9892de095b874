// The compliances of a tissue, condensed onto a row of nodes on the host or by conjugate gradients on a
// device.
#pragma once

#include <cstddef>
#include <memory>

#include "service/base/memory.h"
#include "service/tissue/compliance.h"
#include "service/tissue/tissue_problem.h"

namespace teletact::service {

class CondensedCompliances;
class Device;
class IterativeCompliances;

// Immutable once made, shared by any number of streams, thread-safe.
class TissueModel {
 public:
  // Condenses onto the surface, unless it is fixed. Throws as make_problem(), and MemoryRefused. `before`
  // (may be null): a model of which this one is a change; while it is there, parts of it that are the same
  // are taken over, if it was told that it will change. The numbers are those of a model made without it, to
  // the bit.
  TissueModel(TissueGrid, Material, Supports, const TissueModelOptions&, const TissueModel* before = nullptr);
  const TissueProblem& problem() const { return *problem_; }
  // The compliance of the grid's `row` (0 = the natural surface): condensed; or, by preconditioned conjugate
  // gradients on `device`, its columns computed when they are asked for. Either is kept as long as there is
  // room. Throws std::out_of_range when the row is fixed or absent, MemoryRefused, DeviceError when the
  // device cannot do it.
  std::shared_ptr<Compliance> compliance(std::size_t row,
                                         const std::shared_ptr<Device>& device = nullptr) const;
  // The same where it is ready, null where it would have to be made: never waits for that.
  std::shared_ptr<Compliance> ready(std::size_t row, const std::shared_ptr<Device>& device = nullptr) const;

 private:
  void check_free(std::size_t row) const;

  const std::shared_ptr<const TissueProblem> problem_;
  const Charge charge_;  // of the problem
  const std::shared_ptr<CondensedCompliances> condensed_;
  const std::shared_ptr<IterativeCompliances> iterative_;
};

// Compiles every kernel that compliances by conjugate gradients use, on a model of the size of an ordinary
// window's tissue: the first touch by them must not wait for the compiler.
void warm_iterative(const std::shared_ptr<Device>& device);

}  // namespace teletact::service
