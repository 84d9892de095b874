// The elastic problem of a piece of tissue in plane strain (T4): plain data.
#pragma once

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

// Touched in [touch_begin_m, touch_end_m]; both zero: everywhere. Throws std::invalid_argument naming the
// field: unusable grid or material, no fixed edge (a free body), no touchable column, thickness not positive.
TissueProblem make_problem(TissueGrid, Material, const Supports&, double thickness_m, double touch_begin_m,
                           double touch_end_m);

// Young's modulus of the elements beside `column` just below the row (above it on the last one): their mean.
double modulus_near_pa(const TissueProblem&, std::size_t column, std::size_t row);

}  // namespace teletact::service
