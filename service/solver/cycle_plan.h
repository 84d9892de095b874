// The steps of one multigrid cycle, in order, and the coefficients of those that smooth.
#pragma once

#include <cstddef>
#include <vector>

namespace teletact::service {

// As in kernels/multigrid.cl.
enum class CycleStep : int {
  kResidual,        // residual = right - A correction
  kSmooth,          // a Chebyshev step k on the residual
  kSmoothFromZero,  // the same on the right-hand side, correction = 0 before
  kRestrict,        // right-hand side of the next level from the residual
  kProlong,         // correction from the next level's
  kSolve,           // the coarsest level
  kPack,            // right-hand side of the finest level from a vector
  kUnpack,          // a vector from the correction
};

struct PlannedStep {
  CycleStep step;
  int level = 0, k = 0;
};

// Smoothing by `smoothing_steps` before, between and after the visits to the next level: one from the finest
// level, two from every other (W), so that the coarse problem is solved about equally well on every grid.
// Read backwards it is the same cycle, which keeps it symmetric.
std::vector<PlannedStep> plan_cycle(std::size_t levels, std::size_t smoothing_steps);

// Chebyshev iteration (Saad, Iterative Methods, algorithm 12.1) on [lowest, highest]. Step k: d = old d +
// new D^-1 r, z += d.
struct ChebyshevStep {
  double old_direction = 0, new_residual = 0;
};
std::vector<ChebyshevStep> chebyshev_steps(double lowest, double highest, unsigned steps);

}  // namespace teletact::service
