// A rigid paraboloid of 8 mm, with no skin, pressed without friction on solid tissue: what models of a touch
// are held against. Positions are from the middle of the block's surface.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "bench/suite.h"
#include "service/base/force_budget.h"
#include "service/tissue/solid/recycled_compliance.h"
#include "service/tissue/solid/solid_solver.h"

namespace teletact::bench {

inline constexpr double kTipRadiusM = 0.008;

// Half of the 95 % interval of an answer, over its force, for a truth that is linear.
double linear_half_width(const service::ForceBudget&);

// Number of the surface's unknown: component c at node (i, k), both taken around the period.
std::size_t surface_unknown(const service::SolidGrid& grid, long i, long k, std::size_t c);

// Forces on the surface, N, or how far it is pushed, m: axial, each unknown once.
struct SurfaceValues {
  std::vector<std::size_t> unknowns;
  Eigen::VectorXd values;
};
// The nodes that the paraboloid, `indentation_m` deep at (x, z), overlaps while the tissue is at rest, by how
// much.
SurfaceValues paraboloid_push(const service::SolidGrid&, double x_m, double z_m, double indentation_m);

// Which candidates a rigid tip presses: no pull, and none of the others overlaps it.
struct Pressed {
  Eigen::VectorXd force_n, moved_m;  // of those that are pressed; of all candidates
};
template <class Press>
std::vector<Eigen::Index> settled(const Eigen::VectorXd& overlap_m, Press&& press) {
  constexpr int kMax = 50;
  const double deepest = overlap_m.maxCoeff();
  std::vector<Eigen::Index> active, next;
  for (Eigen::Index n = 0; n < overlap_m.size(); ++n)
    if (overlap_m[n] >= deepest / 2) next.push_back(n);
  for (int tries = 0; tries < kMax && next != active; ++tries) {
    active = next;
    const Pressed p = press(active);
    next.clear();
    auto force = p.force_n.begin();
    for (Eigen::Index n = 0; n < overlap_m.size(); ++n) {
      const bool pressed = std::ranges::binary_search(active, n);
      if (pressed ? *force++ > 0 : overlap_m[n] - p.moved_m[n] > 1e-9 * deepest) next.push_back(n);
    }
  }
  if (next != active) throw BenchError("which nodes touch does not settle");
  return active;
}
// Under candidates whose compliance is s.
struct RigidPress {
  std::vector<Eigen::Index> active;  // of the candidates
  Eigen::VectorXd force_n;           // of these
};
RigidPress press_rigid(const Eigen::MatrixXd& s, const Eigen::VectorXd& overlap_m);

// A block that is pressed at one pose after the other. In double; the period is not felt where the tissue is
// layered (T8.5).
class RigidContact {
 public:
  RigidContact(const service::Queue&, const service::SolidTissue&);
  // Axial, to some 1e-4 of itself. Throws BenchError where it is not found.
  double force_n(double x_m, double z_m, double indentation_m);

 private:
  service::SolidGrid grid_;
  service::SolidSolver<double> solver_;
  const service::SurfaceCompliance wide_;
  service::RecycledCompliance known_;
};

}  // namespace teletact::bench
