#include "service/contact/touch_model.h"

#include <utility>

#include "service/contact/contact_laws.h"

namespace teletact::service {

TouchModel::TouchModel(MemoryAccount account) : laws_(std::make_shared<ContactLaws>(std::move(account))) {}

double indentation_m(const Layer& layer, const TouchPose& pose) {
  double along_m = 0;
  for (std::size_t k = 0; k < 3; ++k) along_m += layer.normal[k] * pose.position_m[k];
  return along_m;
}

TouchPose at_indentation(const Layer& layer, const TouchPose& pose, double wanted_m) {
  const double now_m = indentation_m(layer, pose);
  TouchPose at = pose;
  for (std::size_t k = 0; k < 3; ++k)  // through the layer: exact where it is level
    at.position_m[k] = (pose.position_m[k] - layer.normal[k] * now_m) + layer.normal[k] * wanted_m;
  return at;
}

}  // namespace teletact::service
