// The patch of a solid's surface under a fingertip: which nodes may touch, the programme that says which do
// (T4.5), its energy, and what the block is to be solved under (T8.4).
#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <vector>

#include "service/contact/fingertip.h"
#include "service/contact/patch_solver.h"
#include "service/contact/touch.h"
#include "service/contact/touch_model.h"
#include "service/tissue/solid/recycled_compliance.h"
#include "service/tissue/solid/solid_solver.h"

namespace teletact::service {

// Unknowns of the programme: tangential forces of tied nodes first, then all normal ones.
struct SolidPatch {
  std::vector<std::size_t> nodes;  // i + nx k
  std::vector<NodeOverlap<3>> overlaps;
  std::vector<std::size_t> unknowns;  // of the surface (SurfacePatch)
  std::vector<std::size_t> node_of;   // position in `nodes` of each unknown
  std::vector<double> tie;            // compliance of each tied unknown, m/N
  double pad_m_n = 0;                 // of a pad, of each node; 3 times that sideways
  SkinThickness skin;
  PatchProgramme programme;
};

// Throws std::out_of_range where twice as much as the tip reaches to both sides is not within the period, or
// more nodes are under it than can be solved in time.
void require_room(const SolidGrid&, const Fingertip&, double reach_m, double nodes);

// All nodes that overlap by more than -margin. pose: [x, indentation, z] in the block's coordinates. Throws
// as require_room().
SolidPatch patch_under(const SolidGrid&, const RecycledCompliance&, const Fingertip&, const Vector3& pose,
                       double margin_m);

// Overlap of the node that touches and overlaps least; infinite where none touches.
double min_overlap_m(const SolidPatch&, const PatchSolution&);

// By [x, indentation, z], J.
struct SolidEnergy : PoseEnergy<3> {
  Eigen::MatrixX3d sensitivity;  // (A + D)^-1 v_q of the active unknowns
};
SolidEnergy energy_of(const SolidPatch&, const PatchSolution&);

// The contact linearised where it was found: S p + D p = w + g + D p.
struct LinearisedContact {
  SurfacePatch patch;
  Eigen::VectorXd w_m, force_n;  // force: p where it was found
};
LinearisedContact linearise(const SolidPatch&, const PatchSolution&);

// The single-node contact on solid tissue (T4.5, T8.4): one constraint on the weighted mean of the nodes
// around the pose, as touch_node (touch.h) has it in the plane.
struct SolidTouch {
  SolidEnergy energy;
  LinearisedContact contact;
};

// U = max over f of f.d - f.(B^T S B) f / 2: B the weights, the product of those along x and along z
// (footprint, fingertip.h), d = [0, indentation, 0]; frictionless: f_y alone. Bilateral: the weights are >=
// 0. The contact is linear as it stands: it has forces, no skin and no w. Throws as patch_under, and as
// footprint; std::domain_error where the compliance is not positive definite.
SolidTouch touch_node(const SolidGrid&, const RecycledCompliance&, const Fingertip&, const Vector3& pose);

}  // namespace teletact::service
