// The truth of the plan chart: a rigid tip on nodes ever finer, extrapolated.
#pragma once

#include "bench/rigid_contact.h"
#include "bench/suites/plan/scenes.h"

namespace teletact::bench {

// At so many places a side of a square of one spacing about the pose: the mesh's phase is averaged, and both
// that and the mesh are off by the spacing's square.
double mean_over_shifts(RigidContact&, const PlanPose&, double spacing_m, int a_side);
// From forces on nodes and on nodes half as far apart.
inline double extrapolated(double coarse_n, double fine_n) {
  return (4 * fine_n - coarse_n) / 3;
}

struct TrueForce {
  double coarse_n = 0, fine_n = 0;  // means on nodes 2 and 1 mm apart
  double force_n() const { return extrapolated(coarse_n, fine_n); }
};
// `coarse`: of scene.tissue(1), `fine`: of scene.tissue(2). Throws BenchError where there is none.
TrueForce true_force(RigidContact& coarse, RigidContact& fine, const PlanPose&);

}  // namespace teletact::bench
