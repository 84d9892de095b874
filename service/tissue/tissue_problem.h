// The elastic problem of a piece of tissue in plane strain (T4), and how its model is made: plain data.
#pragma once

#include <cstddef>

#include "service/base/choices.h"
#include "service/base/memory.h"
#include "service/tissue/grid.h"

namespace teletact::service {

struct TissueProblem {
  TissueGrid grid;
  Material material;
  Supports supports;
  double thickness_m = 0.010;                 // out-of-plane contact width of the finger (T: axes)
  double touch_begin_m = 0, touch_end_m = 0;  // where it is touched
  ColumnRange touchable;                      // columns of nodes there that no support holds
};

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

// Throws std::invalid_argument naming the field: unusable grid or material, no fixed edge (a free body), no
// touchable column, thickness not positive.
TissueProblem make_problem(TissueGrid, Material, const Supports&, const TissueModelOptions&);

// Young's modulus of the elements beside `column` just below the row (above it on the last one): their mean.
double modulus_near_pa(const TissueProblem&, std::size_t column, std::size_t row);

}  // namespace teletact::service
