// What a tactile display shows of a contact: its pressure on a grid of taxels around the tip (T8.6).
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "service/contact/touch_model.h"

namespace teletact::service {

// Square taxels around the tip's axis, along x and z of the touched layer.
struct TaxelGrid {
  std::size_t along_x = 8, along_z = 8;
  double pitch_m = 0.002;
};

struct Taxels {
  std::vector<double> pressure_pa;  // [z][x]
  double force_n = 0;               // of all nodes: that of the taxels and what falls beside the grid:
  double outside_n = 0;
  std::array<double, 2> outside_moment_n_m{};  // about the grid's centre: force times x, times z
};

// Each node's force is shared by area among the taxels under a rectangle around it, which is a whole number
// of taxels wide: the least that covers the node's own share of the surface. So the taxels and what falls
// outside have the nodes' force and its first moments, to rounding. What falls beside the grid is stated, not
// moved into its border. `centre_m`: x and z of the grid's centre.
Taxels share_among_taxels(std::span<const NodalPressure>, const TaxelGrid&, std::array<double, 2> centre_m);

struct TactileImage {
  Vector3 centre_m{};  // of the grid, on the undeformed layer, in the scene
  TaxelGrid grid;
  Taxels pressure;
  // Less what tissue whose stiffness changes with depth alone would show at the same force: [z][x]; empty
  // where that is not known.
  std::vector<double> beyond_pa;
};

// Of what presses this layer under the tip. By any thread, beside the layer's touches.
TactileImage tactile_image(const TouchedLayer&, const Fingertip&, const TouchPose&,
                           std::span<const NodalPressure>, const TaxelGrid&, const Vector3& centre_m);

}  // namespace teletact::service
