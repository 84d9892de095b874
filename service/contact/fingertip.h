// Geometry of the fingertips: gap of a node below a punch or a rounded tip, weights of a single-node contact.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "service/contact/contact.h"

namespace teletact::service {

// Throws std::invalid_argument naming the field.
void validate(const Fingertip&);

// Half of its flat part; 0 where it has none.
double flat_half_m(const Fingertip&);

template <int N>
using PoseVector = Eigen::Matrix<double, N, 1>;
template <int N>
using PoseMatrix = Eigen::Matrix<double, N, N>;

// Overlap of a node with a punch or rounded tip, and its derivatives by the pose: [X, indentation], or
// [x, indentation, z] in solid tissue.
template <int N>
struct NodeOverlap {
  double w_m = 0;
  PoseVector<N> slope = PoseVector<N>::Unit(1);
  PoseMatrix<N> curvature = PoseMatrix<N>::Zero();  // 1/m
};

// How far a tip has risen above its lowest part at some distance from the axis, and its derivatives by that.
// Beyond the flat part: r^2 / (2 radius); a sphere's: radius - sqrt(radius^2 - r^2), and where that grows too
// steep, beyond 0.9 of the radius, on along the parabola that touches it there.
struct Rise {
  double m = 0, slope = 0, curvature_1_m = 0;
};
Rise rise(const Fingertip&, double distance_m);

// Of a node at x with a tip at X.
NodeOverlap<2> overlap(const Fingertip&, const PlanePose&, double x_m);

// Half width of the range around the tip's centre where w > -margin_m.
double reach_m(const Fingertip&, double indentation_m, double margin_m);

// Why nodes so far apart are too coarse a mesh for the tip that presses; empty where they are not. A tip that
// only begins to touch is judged as pressed lightly: it overlaps few nodes of any mesh.
std::string coarse_mesh(const Fingertip&, double indentation_m, double spacing_m);

// Standard deviations of a Gaussian footprint that it reaches; what is cut off is 1e-14 of the peak.
inline constexpr double kFootprintReach = 8;

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
