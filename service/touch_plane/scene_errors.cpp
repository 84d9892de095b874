#include "service/touch_plane/scene_errors.h"

#include <algorithm>
#include <cmath>

#include "service/base/choices.h"
#include "service/base/force_budget.h"

namespace teletact::service {
namespace {

bool is_round(const Fingertip& tip) {
  return tip.shape == FingertipShape::kRoundedTip || tip.shape == FingertipShape::kSphere;
}

std::optional<FeltDeviation> stated_log_deviation(const SceneSnapshot& snapshot, const WindowModel& window,
                                                  const FeltPlace& place) {
  if (snapshot.modulus) return felt_log_deviation(*snapshot.modulus, place);
  if (!window.evidence) return std::nullopt;  // given
  const WindowEvidence& e = *window.evidence;
  return FeltDeviation{e.log_deviation > 0 ? e.log_deviation
                                           : std::hypot(choices::kUnseenDeviation, e.common_deviation)};
}

}  // namespace

FeltPlace felt_by(const Fingertip& tip, const Layer& layer, const TouchPose& pose) {
  constexpr double kLeastM = 1e-3;
  const double pressed_m = std::max(choices::kLightTouch, indentation_m(layer, pose)),
               radius_m = is_round(tip) ? std::sqrt(tip.radius_m * pressed_m) : tip.half_width_m;
  return {pose.position_m[0], layer.depth_m, pose.position_m[2], std::max(kLeastM, radius_m)};
}

SceneErrors scene_errors(const Scene& scene, const SceneSnapshot& snapshot, const WindowModel& window,
                         const Fingertip& tip, const Layer& layer, const TouchPose& pose) {
  constexpr double kBesideShare = 0.07;
  SceneErrors out;
  out.log_deviation = stated_log_deviation(snapshot, window, felt_by(tip, layer, pose));
  const auto& [x_m, d_m, z_m] = pose.position_m;
  out.stiffening = scene.geometry().linear ? 0 : stiffening(tip, d_m);
  const Region& region = window.region;
  if (!region.z || !is_round(tip) || !(d_m > 0)) return out;
  const double depth_m = scene.geometry().depth_m - layer.depth_m, radius_m = std::sqrt(tip.radius_m * d_m);
  out.end_away_m = std::max(0.0, std::min({x_m - region.begin_x_m, region.end_x_m - x_m,
                                           z_m - region.z->begin_m, region.z->end_m - z_m}));
  const double borne = kBesideShare * depth_m * radius_m / (out.end_away_m * (out.end_away_m + depth_m / 4));
  out.beyond_end = std::min(0.5, borne) * std::log(3);
  if (out.log_deviation && out.log_deviation->measured > 0)
    out.lost_by_sliding = lost_by_sliding(tip, d_m, depth_m);
  return out;
}

void SceneErrors::add_to(ContactAnswer& contact) const {
  if (contact.budget.terms().empty()) return;
  if (beyond_end > 0)
    contact.budget.add({ErrorTerm::kContext, TermKind::kEstimate, beyond_end / ForceBudget::kOf95});
  if (log_deviation)
    contact.budget.add({ErrorTerm::kModulus, TermKind::kDeviation,
                        std::hypot(log_deviation->measured, lost_by_sliding / ForceBudget::kOf95)});
  if (log_deviation && log_deviation->between > 0)
    contact.budget.add({ErrorTerm::kSlices, TermKind::kDeviation, log_deviation->between});
  contact.budget.above = stiffening;
}

}  // namespace teletact::service
