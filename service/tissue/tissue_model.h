// The compliances of a tissue: its problem, what condenses it onto a row of nodes and what solves for
// one by conjugate gradients, and the bounded cache of interior rows. Immutable once made, shared by any
// number of streams.
#pragma once

#include <cstddef>
#include <memory>

#include "service/base/choices.h"
#include "service/base/memory.h"
#include "service/tissue/compliance.h"
#include "service/tissue/tissue_problem.h"

namespace teletact::service {

class Device;
class IterativeCompliances;
class ComplianceCache;
class Condenser;

struct TissueModelOptions {
  // Columns of nodes within [touch_begin_m, touch_end_m] can be touched: compliance is kept among them alone.
  // A tip needs a node under all of its overlap, so reach past the window by the tip's half width. Both zero:
  // every free column.
  double touch_begin_m = 0, touch_end_m = 0;
  double thickness_m = 0.010;  // out-of-plane contact width of the finger (T: axes), > 0
  // Layers below the surface will be touched: where tissue is eliminated row by row, keeps for them what the
  // surface's elimination passes through, 32 nx^2 ny bytes until their first use, which then takes a third
  // less time.
  bool interior_layers = false;
  // The modulus will change in part: where tissue is eliminated column by column, keeps what a model made
  // from this one can take over, at most 32 (T^2 + 2 T L + 4 L^2) bytes for each row in use, T touchable
  // columns, L free rows.
  bool will_change = false;
  std::size_t max_compliance_bytes = choices::kMaxComplianceBytes;  // of those kept for interior rows
  MemoryAccount account = {};  // in whose name the model and all that is made for it is held
};

// Thread-safe; the surface row is condensed in the constructor (unless it is fixed), interior rows (T4.4)
// on first use.
class TissueModel {
 public:
  // Throws as make_problem(), and MemoryRefused. `before` (may be null): a model of which this one is a
  // change; parts of it that are the same are taken over, if it was told that it will change. The numbers are
  // those of a model made without it, to the bit.
  TissueModel(TissueGrid, Material, Supports, const TissueModelOptions&, const TissueModel* before = nullptr);
  ~TissueModel();
  const TissueProblem& problem() const { return *problem_; }
  // The condensed compliance of the grid's `row` (0 = the natural surface). Throws std::out_of_range when the
  // row is fixed or absent. `before`: as above, used where the row has not been condensed yet.
  std::shared_ptr<Compliance> condensed(std::size_t row, const TissueModel* before = nullptr) const;
  // The same where it is ready, null where it would have to be made: never waits for a condensation.
  std::shared_ptr<Compliance> made(std::size_t row) const;
  // The same by preconditioned conjugate gradients on `device`, columns computed when asked for. The model
  // keeps one for each row and device, solved by iterative_options, so that the columns are kept too, as
  // long as there is room for them. Throws std::out_of_range as above, DeviceError when the device cannot do
  // it.
  std::shared_ptr<Compliance> iterative(std::size_t row, const std::shared_ptr<Device>& device) const;
  // Held for each row that is condensed onto; operations in floating point to condense one.
  std::size_t compliance_bytes() const;
  double condensation_operations() const;

 private:
  const std::shared_ptr<const TissueProblem> problem_;
  const Charge charge_;  // of the problem
  const std::shared_ptr<Condenser> condenser_;
  const std::shared_ptr<Compliance> surface_;  // null where it is fixed
  const std::shared_ptr<ComplianceCache> interior_;
  const std::shared_ptr<IterativeCompliances> iterative_;
};

// Compiles every kernel that iterative() uses, on a model of the size of an ordinary window's tissue: the
// first touch by PCG must not wait for the compiler.
void warm_iterative(const std::shared_ptr<Device>& device);

}  // namespace teletact::service
