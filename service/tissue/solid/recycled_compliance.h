// The surface's compliance S = G + dS. G = S0 + D S_l D - S_l is the guess: layered tissue's S0, its smooth
// part S_l scaled by how stiff the tissue is felt at each node (element_shares.h). dS is known from contacts
// that were solved on the whole block (T8.4): pairs (p, dS p) of forces and of what the surface moves by
// beyond the guess. With E = dS Q, Q an orthonormal basis of the forces,
//   S' = G + E Q^T + Q E^T - Q (Q^T E) Q^T
// is exact for the pairs, and S - S' is dS between what lies beyond them.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <deque>
#include <memory>
#include <utility>
#include <vector>

#include "service/tissue/solid/element_shares.h"
#include "service/tissue/solid/solid_solver.h"
#include "service/tissue/solid/solid_tissue.h"
#include "service/tissue/solid/surface_compliance.h"

namespace teletact::service {

class RecycledCompliance {
 public:
  // Of components first ... first + count - 1 of the surface (1, 1: frictionless). Keeps so many pairs, the
  // newest. `wide`: S0 without the block's period; `periodic`: with it, as the pairs have it; both of the
  // factor's layers, which the tissue's may have left: S0 is `scale` times that (T8.7). They must outlive it.
  RecycledCompliance(const SolidGrid&, const LayeredTissue&, std::size_t first, std::size_t count,
                     const SurfaceCompliance& wide, const SurfaceCompliance& smooth,
                     const SurfaceCompliance& periodic, double scale = 1, std::size_t max_pairs = 12);
  // From now on the guess is scaled by this; pairs there are none yet.
  void feel(std::shared_ptr<const FeltModulus> felt) { felt_ = std::move(felt); }
  // Forces of unknowns of the surface (SurfacePatch) and their excess beyond the factor's layered tissue.
  void add(const std::vector<std::size_t>& unknowns, const Eigen::VectorXd& force_n, const RowExcess&);
  // S0 of a node under its own force, of a component, m/N: it does not change with D or the pairs.
  double layered(std::size_t component) const { return scale_ * wide_(component, component, 0, 0); }
  // S' among unknowns, m/N.
  Eigen::MatrixXd among(const std::vector<std::size_t>& unknowns) const;
  // S' f at these nodes of the row, m: how far they move along y under forces of these unknowns.
  Eigen::VectorXd moved_m(const std::vector<std::size_t>& nodes, const std::vector<std::size_t>& unknowns,
                          const Eigen::VectorXd& force_n) const;
  // By how much more the wide surface moves than the periodic one, m: what a contact that is solved on the
  // block, which is periodic, must be given.
  Eigen::VectorXd wider_m(const std::vector<std::size_t>& unknowns, const Eigen::VectorXd& force_n) const;
  // About |a.(S - S') b|, a and b forces of these unknowns, for each column of a: what lies beyond the pairs,
  // dS being as large there, over G, as it was found between them; and what the pairs are off by. Where b is
  // mostly beyond them, what dS is at most.
  Eigen::VectorXd error_between(const std::vector<std::size_t>& unknowns, const Eigen::MatrixXd& a,
                                const Eigen::VectorXd& b) const;
  // What a guess may be off by at a node of the row over itself (FeltModulus::beyond): 0 where all is
  // layered.
  double beyond_layers(std::size_t node) const {
    return felt_ ? felt_->beyond[static_cast<Eigen::Index>(node)] : largest_;
  }
  std::size_t pairs() const { return pairs_.size(); }

 private:
  struct Pair {
    Eigen::VectorXd force, excess, last, guess;  // p, dS p, its last step, G p of the whole surface
    double share = 0;                            // |dS p| / |G p| where p presses
  };
  std::vector<Eigen::Index> places(const std::vector<std::size_t>& unknowns) const;
  // Of the pairs, a column each, at these places.
  Eigen::MatrixXd columns(Eigen::VectorXd Pair::*, const std::vector<Eigen::Index>& at) const;
  Eigen::VectorXd scale_at(const std::vector<std::size_t>& unknowns) const;  // D
  Eigen::MatrixXd guess_among(const std::vector<std::size_t>& unknowns) const;
  double max_beyond(const std::vector<std::size_t>& unknowns, const Eigen::VectorXd& p) const;
  void orthonormalise();
  SolidGrid grid_;
  std::size_t first_, count_;
  double scale_;
  double largest_;  // of S - S0 over S0, at most
  const SurfaceCompliance &wide_, &smooth_, &periodic_;
  std::size_t max_pairs_;
  std::shared_ptr<const FeltModulus> felt_;        // null: D = 1
  std::deque<std::shared_ptr<const Pair>> pairs_;  // the newest first
  Eigen::MatrixXd basis_;                          // Q = P basis_, P the pairs' forces
  Eigen::MatrixXd core_, gram_;                    // Q^T dS Q, Q^T G Q
};

}  // namespace teletact::service
