// A round tip on solid tissue by one line (T9.2): the layered tissue's force times exp(m), m the mean of
// ln(E / E0) with the shares that elements have in that force. No mesh under the tip and no device: some
// microseconds a touch.
#pragma once

#include <memory>

#include "service/contact/layered_touch.h"
#include "service/contact/touch_model.h"
#include "service/solid/force_shares.h"

namespace teletact::service {

// U(x, d, z) = Int_0^d F0(d') exp(m(x, z, a(d'))) dd'. Immutable: by any number of threads.
class LogWeightedTouch {
 public:
  // Both of the same layers, and of tissue whose E0 is theirs over `softer`.
  LogWeightedTouch(std::shared_ptr<const LayeredTouch>, std::shared_ptr<const FeltForce>, double softer = 1);
  // Force, tangent and energy. pose: [x, indentation, z] in the block. Throws as LayeredTouch::at().
  ContactAnswer answer(const Vector3& pose) const;
  // What is felt there: what answer() does not know grows with the variance. Nothing above the surface.
  FeltForce::At felt(const Vector3& pose) const;

 private:
  std::shared_ptr<const LayeredTouch> layered_;
  std::shared_ptr<const FeltForce> felt_;
  double softer_;
};

}  // namespace teletact::service
