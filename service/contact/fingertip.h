// Geometry of the fingertips: gap of a node below a punch or a rounded tip, weights of a single-node contact.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "service/contact/contact.h"

namespace teletact::service {

// Throws std::invalid_argument naming the field.
void validate(const Fingertip&);

// Half of its flat part; 0 where it has none.
double flat_half_m(const Fingertip&);

// Overlap w of a node at x with a punch or rounded tip at X, and its derivatives by X (dw/d indentation = 1).
struct Overlap {
  double w_m = 0;
  double slope = 0;          // dw/dX
  double curvature_1_m = 0;  // d2w/dX2
};
Overlap overlap(const Fingertip&, const PlanePose&, double x_m);

// Half width of the range around the tip's centre where w > -margin_m.
double reach_m(const Fingertip&, double indentation_m, double margin_m);

// Weights b of the single-node contact (sum 1) over the nodes first ... first + b.rows() - 1 of `x_m`, as
// columns [b, db/dX, d2b/dX2]. Hat function: piecewise linear in X; at a node its slope is the mean of both
// sides. Gaussian footprint: exp(-d^2 / 2 sigma^2) times the node's tributary width, normalised; smooth in X.
struct Footprint {
  std::size_t first = 0;
  Eigen::Matrix<double, Eigen::Dynamic, 3> weights;
};
// `columns`: the nodes that may be used; X must lie between the outermost. Throws std::invalid_argument when
// the footprint is too narrow for the grid.
Footprint footprint(const Fingertip&, double x_m, std::span<const double> grid_x_m, ColumnRange columns);

// Half of the distance between the neighbours of node i (at an end: of the one beside it).
double tributary_width_m(std::span<const double> grid_x_m, std::size_t i);

}  // namespace teletact::service
