// The surface's compliance S = S0 + dS, S0 that of layered tissue, dS known from contacts that were solved on
// the whole block (T8.4): pairs (p, dS p) of forces and of what the surface moves by beyond the layered
// tissue's. With D = dS Q, Q an orthonormal basis of the forces,
//   S' = S0 + D Q^T + Q D^T - Q (Q^T D) Q^T
// is exact for the pairs, and S - S' is dS between what lies beyond them.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <deque>
#include <vector>

#include "service/solid/solid_solver.h"
#include "service/solid/solid_tissue.h"
#include "service/solid/surface_compliance.h"

namespace teletact::service {

class RecycledCompliance {
 public:
  // Of components first ... first + count - 1 of the surface (1, 1: frictionless). Keeps so many pairs, the
  // newest. `wide`: S0 without the block's period; `periodic`: with it, as the pairs have it; both of the
  // factor's layers, which the tissue's may have left: S0 is `scale` times that (T8.7).
  RecycledCompliance(const SolidGrid&, const LayeredTissue&, std::size_t first, std::size_t count,
                     const SurfaceCompliance& wide, const SurfaceCompliance& periodic, double scale = 1,
                     std::size_t most_pairs = 12);
  // Forces of unknowns of the surface (SurfacePatch) and their dS p.
  void add(const std::vector<std::size_t>& unknowns, const Eigen::VectorXd& force_n, const SurfaceExcess&);
  // S0 of a node under its own force, of a component, m/N: it does not change with the pairs.
  double layered(std::size_t component) const { return scale_ * wide_(component, component, 0, 0); }
  // S' among unknowns, m/N.
  Eigen::MatrixXd among(const std::vector<std::size_t>& unknowns) const;
  // By how much more the wide surface moves than the periodic one, m: what a contact that is solved on the
  // block, which is periodic, must be given.
  Eigen::VectorXd wider_m(const std::vector<std::size_t>& unknowns, const Eigen::VectorXd& force_n) const;
  // About |a.(S - S') b|, a and b forces of these unknowns, for each column of a: what lies beyond the pairs,
  // dS being as large there, over S0, as it was found between them; and what the pairs are off by. Without
  // pairs, at most.
  Eigen::VectorXd error_between(const std::vector<std::size_t>& unknowns, const Eigen::MatrixXd& a,
                                const Eigen::VectorXd& b) const;
  std::size_t pairs() const { return pairs_.size(); }

 private:
  struct Pair {
    Eigen::VectorXd force, excess, last, layered;  // p, dS p, its last step, S0 p of the whole surface
    double share = 0;                              // |dS p| / |S0 p| where p presses
  };
  std::vector<Eigen::Index> places(const std::vector<std::size_t>& unknowns) const;
  SolidGrid grid_;
  std::size_t first_, count_;
  double scale_;
  double largest_;    // of dS over S0, at most
  double found_ = 0;  // the most of the pairs
  const SurfaceCompliance &wide_, &periodic_;
  std::size_t most_pairs_;
  std::deque<Pair> pairs_;                           // the newest first
  Eigen::MatrixXd basis_, excess_, last_, layered_;  // Q, dS Q, S0 Q
  Eigen::MatrixXd core_, gram_;                      // Q^T dS Q, Q^T S0 Q
};

}  // namespace teletact::service
