// The force of a rigid round tip on tissue, by elements that share nothing with the service's.
#pragma once

#include <cmath>
#include <functional>

#include "bench/independent/hexahedra.h"

namespace teletact::bench {

// Planes x and z = const at which tissue ends.
struct Sides {
  double left_m = -HUGE_VAL, right_m = HUGE_VAL, near_m = -HUGE_VAL, far_m = HUGE_VAL;
};

// A paraboloid without friction. Lengths in m, from where its axis enters: y into the tissue.
struct RoundTouch {
  double radius_m = .008, indentation_m = .002, depth_m = .040, poisson_ratio = .49;
  double bed_m = 0;     // more below, of another modulus
  bool slides = false;  // on its bottom; else it is bonded there
  Sides sides{};        // free; 2.5 depths away at most
  std::function<double(const Hexahedra::Point&)> modulus_pa;
};

// N. A contact's area makes the force at an indentation as large as it can be (Barber, Journal of Strain
// Analysis 9, 1974), so that the largest over the radii of circles of nodes errs by the square of what the
// circle does. `across`: elements over the contact's radius; all others grow with them. Throws
// std::invalid_argument where the axis does not enter the tissue.
double round_touch_n(const RoundTouch&, double across = 4);

}  // namespace teletact::bench
