// Modulus methods of others, each from its publication, in double precision on one thread of the host.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "bench/peers/tracker.h"
#include "service/imaging/modulus/tissue_extent.h"

namespace teletact::bench {

// What ours are given too.
struct ModulusProblem {
  const Track& track;                 // ours
  const std::vector<double>& strain;  // axial, at the nodes of the track; NaN where not determined
  double window_width_m = 0, window_depth_m = 0;
  service::TissueExtent tissue;
  service::ProbeForce force;
};

struct ModulusPeer {
  std::string name;
  // Young's modulus (Pa) at the nodes, NaN where nothing can be said.
  std::function<std::vector<float>(const ModulusProblem&)> estimate;
};

// E = mean pressure / strain (T3.0; Ophir et al. 1991, doi 10.1177/016173469101300201), median over 5 x 5
// nodes.
ModulusPeer make_inverse_strain();
// Gauss-Newton on the logarithm of the modulus of 3 mm patches, its Jacobian by finite differences: Kallel &
// Bertrand 1996, doi 10.1109/42.500139. Plane strain.
ModulusPeer make_gauss_newton();

}  // namespace teletact::bench
