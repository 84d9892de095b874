// Compliance of one row of nodes by elimination column by column, from both ends of the tissue to a column
// in between, the seam (T4.2c).
//
// A side is the tissue from one end to a column c. With c held its touched nodes have the compliance H, and
// they follow c by U; c feels the stiffness A. The next column n, coupled by E = K(n, c), c's own stiffness
// complete: with X = A^-1,
//   H' = [H + U X U^T, U X s; ., s^T X s],  U' = -[U; s^T] X E^T,  A' = D - E X E^T,
// s choosing the touched node of c; D has the elements on the side alone. At the seam X = (A_left +
// A_right)^-1, and the compliance is diag(H_left, 0, H_right) + [U_left; s^T; U_right] X [...]^T: sums of
// positive terms. A side does not know what lies beyond it: where only that changed, it is taken over.
// Cost: an inverse of m^3 flops for each column, m = 2 ny, and m^2 T^2 + m T^3 / 3 for T touched nodes.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <memory>

#include "service/tissue/condensation.h"

namespace teletact::service {

// Which nodes are touched: those of one row in a range of columns.
struct TouchedNodes {
  Eigen::Index position = 0;  // of the row among the free rows
  ColumnRange columns;
};

struct CondensedSide {
  std::size_t column = 0;     // that it reaches
  Eigen::MatrixXd stiffness;  // A, lower triangle
  Eigen::MatrixXd held;       // H, lower triangle; touched nodes from the outermost one inwards, [u_x, u_y]
  Eigen::MatrixXd following;  // U
};

// The sides left [0] and right [1] of the seam, and what they pass halfway; each may be null.
struct CondensedSides {
  std::array<std::shared_ptr<const CondensedSide>, 2> halfway, whole;
};

// Those that stay the same when the modulus changes from `before` to `now`; the others null.
CondensedSides unchanged(const CondensedSides&, const TissueGrid&, const Material& before,
                         const Material& now);

// Condenses the sides; what `known` holds is taken over. Throws std::domain_error as invert_symmetric().
CondensedSides condensed_sides(const LayeredStiffness& columns, const TouchedNodes&,
                               const CondensedSides& known);
// The compliance among the touched nodes, from the left; lower triangle.
Eigen::MatrixXd joined(const CondensedSides&, const TouchedNodes&);

// Operations in floating point to the surface, by columns as here and by rows (condensation.h).
struct CondensationCost {
  double by_rows = 0, by_columns = 0;
  bool columns_are_cheaper() const { return by_columns < by_rows; }
};
CondensationCost condensation_cost(const FreeNodes&, const ColumnRange& touched);

}  // namespace teletact::service
