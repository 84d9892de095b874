#include "service/contact/touch_model.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "service/contact/contact_laws.h"

namespace teletact::service {

TouchModel::TouchModel(MemoryAccount account, MadeOf made_of)
    : made_of_(std::move(made_of)), laws_(std::make_shared<ContactLaws>(std::move(account))) {}

bool round_and_frictionless(const Fingertip& tip) {
  return tip.friction == Friction::kFrictionless &&
         (tip.shape == FingertipShape::kRoundedTip || tip.shape == FingertipShape::kSphere);
}

double indentation_m(const Layer& layer, const TouchPose& pose) {
  double along_m = 0;
  for (std::size_t k = 0; k < 3; ++k) along_m += layer.normal[k] * pose.position_m[k];
  return along_m;
}

std::vector<std::size_t> every(const std::vector<std::size_t>& indices, std::size_t most) {
  const std::size_t step = indices.size() / (most + 1) + 1;
  std::vector<std::size_t> out;
  std::ranges::copy_if(indices, std::back_inserter(out), [step](std::size_t i) { return i % step == 0; });
  return out;
}

TouchPose at_indentation(const Layer& layer, const TouchPose& pose, double wanted_m) {
  const double now_m = indentation_m(layer, pose);
  TouchPose at = pose;
  for (std::size_t k = 0; k < 3; ++k)  // through the layer: exact where it is level
    at.position_m[k] = (pose.position_m[k] - layer.normal[k] * now_m) + layer.normal[k] * wanted_m;
  return at;
}

}  // namespace teletact::service
