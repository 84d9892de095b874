#include "bench/suites/plan/truth.h"

namespace teletact::bench {

double mean_over_shifts(RigidContact& contact, const PlanPose& pose, double spacing_m, int a_side) {
  double sum = 0;
  const auto shift = [&](int n) { return ((n + 0.5) / a_side - 0.5) * spacing_m; };
  for (int a = 0; a < a_side; ++a)
    for (int b = 0; b < a_side; ++b)
      sum += contact.force_n(pose.x_m + shift(a), pose.z_m + shift(b), pose.indentation_m);
  return sum / (a_side * a_side);
}

TrueForce true_force(RigidContact& coarse, RigidContact& fine, const PlanPose& pose) {
  return {mean_over_shifts(coarse, pose, kVoxelM, 4), mean_over_shifts(fine, pose, kVoxelM / 2, 2)};
}

}  // namespace teletact::bench
