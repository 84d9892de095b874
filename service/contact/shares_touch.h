// A frictionless round tip on the surface of solid tissue by one line (T9.2): the layered tissue's force
// times exp(m), m the mean of ln(E / E0) with the shares that elements have in that force. No mesh under the
// tip and no device: some microseconds a touch. It says what it may be off by before it is asked.
#pragma once

#include <memory>
#include <vector>

#include "service/base/force_budget.h"
#include "service/contact/layered_touch.h"
#include "service/contact/touch_model.h"
#include "service/tissue/solid/element_shares.h"
#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

// What of finite strain, which every model lacks, a tolerance is to leave room for.
enum class FiniteStrain { kLeftOut, kCounts };

// U(x, d, z) = Int_0^d F0(d') exp(m(x, z, a(d'))) dd'. Poses are [x, indentation, z] in the block.
// Half-widths are of the interval that holds the solid's force in 95 of 100, over that force, all components
// of it. Immutable: by any number of threads.
class SharesTouch {
 public:
  // layers: of the tissue's E0 times `softer`, as `felt`, and of the same tip.
  SharesTouch(const SolidTissue&, const Fingertip&, std::shared_ptr<const LayeredTouch> layers,
              std::shared_ptr<const FeltForce> felt, double softer);
  double max_m() const { return max_m_; }  // indentation that it knows; 0: none, ask for nothing else
  double half_width(const Vector3& pose) const;
  double max_half_width(double indentation_m) const;  // of any place so deep
  // That over what is allowed.
  double over(const Vector3& pose, const Tolerance&, FiniteStrain) const;
  // Force, tangent, energy and strain, with its budget; no pressure. Throws as LayeredTouch::at().
  ContactAnswer answer(const Vector3& pose) const;

 private:
  FeltForce::At felt(const Vector3& pose) const;
  const Fingertip tip_;
  const SolidGrid grid_;
  const double poisson_ratio_;
  const std::shared_ptr<const LayeredTouch> layers_;
  const std::shared_ptr<const FeltForce> felt_;
  const double softer_;
  std::vector<float> near_pa_;  // modulus around each node of the surface
  double max_m_ = 0;
};

}  // namespace teletact::service
