// Measurement and forward model on the strip's nodes under the probe: the common ground of the direct and the
// iterative modulus (T3.2, T3.3). Node (i, j) at (i dx_m, j dy_m) in window
// coordinates, index i + nx j.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "service/imaging/modulus/strip_model.h"
#include "service/imaging/tracking/measured.h"

namespace teletact::service {

struct WindowNodes {
  explicit WindowNodes(const StripModel&);
  std::size_t nx = 0, ny = 0;
  double dx_m = 0, dy_m = 0;
  std::size_t size() const { return nx * ny; }
  // Values of the nodes at the nodes of an image grid, bilinear; NaN beyond them.
  Field on_image(const std::vector<double>& node_values, const ImageGrid&) const;
};

// Slopes of the axial displacement by plane fits over the nodes' neighbourhood, weights falling linearly to 0
// at the reach from the node (T2.4 with a kernel of its own: sharper than that of the strain map).
inline constexpr double kSlopeReachXM = 1.5e-3, kSlopeReachYM = 1.2e-3;
struct AxialSlopes {
  std::vector<double> across, along;   // du_y/dx, du_y/dy
  std::vector<std::uint8_t> measured;  // 1: enough of the neighbourhood is trusted
};
AxialSlopes axial_slopes(const WindowNodes&, const Measured&);

// A forward model's answer on the nodes for a push of 1 m.
struct ModelState {
  std::vector<double> along, across;  // du_y/dy, du_y/dx
  std::vector<double> lateral;        // du_x/dx
  std::vector<double> shear;          // tensor component eps_xy
  std::vector<double> pressure;       // -lambda div u, Pa
  std::vector<double> log_modulus;    // mean of the elements that meet at the node
};
ModelState model_state(const StripModel&, const StripResponse&, const std::vector<double>& youngs_modulus_pa);

}  // namespace teletact::service
