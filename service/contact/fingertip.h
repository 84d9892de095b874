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

// The skin of a punch or a rounded tip: a thin layer that spreads the moment at which a node begins to touch,
// so that force and tangent are smooth in the pose (T4.5b). A rigid tip meets the nodes one by one, and its
// tangent jumps by some percent at each.
//
// A node that bears p (N/m) keeps the gap g = t (s - kSkinMiddle) from the tip, where s in (0, 1] solves
//   p = b t (1 - s)^2 / s,   b = kSkinStiffness / S_ii:
// p rises from 0 at s = 1 with its slope, and s falls to 0 as p grows. t is the thickness of the skin: what
// the tip rises by between the outermost node in contact and the next, about. It shrinks with the mesh and
// vanishes with the indentation. The middle is chosen so that the force is, in the mean, the rigid tip's.
// W(p, t) = Int_0^p g dp is the skin's part of the energy that the contact maximises (touch.h).
constexpr double kSkinStiffness = 0.1;
constexpr double kSkinMiddle = 0.12;

// Of one node, and its derivatives by the indentation: t = d h / (h + a), h the node's width, a half of the
// undeformed overlap.
struct SkinThickness {
  double t_m = 0, slope = 0, curvature_1_m = 0;
};
SkinThickness skin_thickness(const Fingertip&, double indentation_m, double width_m);

struct SkinState {
  double s = 1, rest = 0;  // rest = 1 - s
  double gap_m = 0;
  double compliance = 0;  // -dg/dp, m per N/m; infinite at p = 0
  double gap_by_t = 0;    // dg/dt at constant p
};
// `stiffness`: b. p >= 0.
SkinState skin_state(double p, double stiffness, double thickness_m);

struct SkinEnergy {
  double w = 0, by_t = 0, by_t2 = 0;  // W and its derivatives by t at constant p
};
SkinEnergy skin_energy(const SkinState&, double p, double stiffness, double thickness_m);

}  // namespace teletact::service
