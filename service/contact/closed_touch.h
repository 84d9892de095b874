// A frictionless round tip on the surface of solid tissue without nodes (T9.5): three models cheaper than the
// solid, and what each may be off by before it is asked.
#pragma once

#include <memory>
#include <vector>

#include "service/contact/layered_touch.h"
#include "service/contact/log_weighted_touch.h"
#include "service/contact/touch_model.h"
#include "service/plan/force_budget.h"
#include "service/solid/force_shares.h"
#include "service/solid/solid_tissue.h"

namespace teletact::service {

// What of finite strain, which every model lacks, a tolerance is to leave room for.
enum class FiniteStrain { kLeftOut, kCounts };

// The models are SolvePath::kLayer, kLayers and kShares. Half-widths are of the interval that holds the
// solid's force in 95 of 100, over that force, all components of it. Immutable: by any number of threads.
class ClosedTouch {
 public:
  // unit_layer: a homogeneous layer as deep as the tissue, of 1 Pa. layers: of the tissue's E0 times
  // `softer`, as `felt`. All of the same tip.
  ClosedTouch(const SolidTissue&, const Fingertip&, std::shared_ptr<const LayeredTouch> unit_layer,
              std::shared_ptr<const LayeredTouch> layers, const std::shared_ptr<const FeltForce>& felt,
              double softer);
  double most_m() const { return most_m_; }  // indentation that it knows; 0: none, ask for nothing else
  double modulus_pa() const { return modulus_pa_; }  // of the homogeneous layer

  // Of kShares there; of the others of any place so deep. Pose: [x, indentation, z] in the block.
  double half_width(SolvePath, const Vector3& pose) const;
  // Over what is allowed: there, and the most of any place and depth.
  double over(SolvePath, const Vector3& pose, const Tolerance&, FiniteStrain) const;
  double most_over(SolvePath, const Tolerance&, FiniteStrain) const;
  // The most of any place so deep.
  double most_half_width(SolvePath, double indentation_m) const;
  // Force, tangent, energy and strain, with its budget; no pressure. Throws as LayeredTouch::at().
  ContactAnswer answer(SolvePath, const Vector3& pose) const;

 private:
  struct Depth {
    double indentation_m, layer_n, layers_n;
    FeltForce::Extent felt;  // of the contact radii around its own
  };
  // Of a place where ln F is m above the layers'.
  double half_width(SolvePath, const Depth&, double m) const;
  double most_half_width(SolvePath, const Depth&) const;
  double left(double force_n, double indentation_m, const Tolerance&, FiniteStrain) const;
  const Fingertip tip_;
  const SolidGrid grid_;
  const double poisson_ratio_;
  const std::shared_ptr<const LayeredTouch> unit_layer_, layers_;
  const double softer_;
  const LogWeightedTouch shares_;
  std::vector<float> near_pa_;  // modulus around each node of the surface
  std::vector<Depth> depths_;   // increasing
  double most_m_ = 0, modulus_pa_ = 0;
};

}  // namespace teletact::service
