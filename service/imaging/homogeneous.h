// The homogeneous tissue that the reference stress compares with (T3.1): same geometry, supports and probe.
#pragma once

#include <cstddef>
#include <list>
#include <memory>

#include "service/imaging/frame.h"

namespace teletact::service {

// What the probe does to homogeneous tissue of 1 Pa when it pushes its face down by 1 m (linear, so any
// unit).
struct HomogeneousResponse {
  Field axial_strain;        // eps_yy (< 0) at the nodes of an image grid; NaN below or beside the tissue
  double force_n_per_m = 0;  // per metre of thickness, > 0
};

// Plane strain, Q1 (T4), on the strip of the window with 60 mm of context on each side, cut at the tissue's
// sides; bottom bonded, sides free, u_y prescribed on the surface under the whole window, frictionless. 1 mm
// elements under the probe, growing away from it. Throws std::invalid_argument naming the field of the
// extent.
HomogeneousResponse homogeneous_response(const TissueExtent&, double window_width_m, const ImageGrid&);

// Keeps the responses of the latest geometries. Windows with the same context share one. Not thread-safe.
class HomogeneousCache {
 public:
  std::shared_ptr<const HomogeneousResponse> get(const TissueExtent&, double window_width_m,
                                                 const ImageGrid&);
  static constexpr std::size_t kMost = 32;

 private:
  struct Entry {
    double left_m, right_m, depth_m, poisson_ratio, width_m;
    ImageGrid grid;
    std::shared_ptr<const HomogeneousResponse> response;
  };
  std::list<Entry> entries_;  // latest used first
};

}  // namespace teletact::service
