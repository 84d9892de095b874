#include "service/touch_plane/scene_errors.h"

#include <algorithm>

#include "service/base/choices.h"
#include "service/scene/slices.h"

namespace teletact::service {

std::optional<double> stated_log_deviation(const SceneSnapshot& snapshot, const WindowModel& window,
                                           const Layer& layer, const TouchPose& pose) {
  if (snapshot.modulus)
    return felt_log_deviation(*snapshot.modulus, pose.position_m[0], layer.depth_m, pose.position_m[2]);
  if (!window.evidence) return std::nullopt;  // given
  const WindowEvidence& e = *window.evidence;
  return std::hypot(e.log_deviation > 0 ? e.log_deviation : choices::kUnseenDeviation,
                    e.force_relative_deviation, e.area_relative_deviation);
}

Beside beside_what_was_given(const Region& region, const Fingertip& tip, const TouchPose& pose,
                             double depth_m) {
  constexpr double kBesideShare = 0.07;
  const auto& [x_m, d_m, z_m] = pose.position_m;
  const bool round = tip.shape == FingertipShape::kRoundedTip || tip.shape == FingertipShape::kSphere;
  if (!region.z || !round || !(d_m > 0)) return {};
  const double radius_m = std::sqrt(tip.radius_m * d_m),
               away_m = std::max(0.0, std::min({x_m - region.begin_x_m, region.end_x_m - x_m,
                                                z_m - region.z->begin_m, region.z->end_m - z_m}));
  const double borne = kBesideShare * depth_m * radius_m / (away_m * (away_m + depth_m / 4));
  return {away_m, std::min(0.5, borne) * std::log(3)};
}

void add_scene_errors(const std::optional<double>& log_deviation, const Beside& beside,
                      ContactAnswer& contact) {
  if (contact.budget.terms().empty()) return;
  if (beside.share > 0)
    contact.budget.add({ErrorTerm::kContext, TermKind::kEstimate, beside.share / ForceBudget::kOf95});
  if (log_deviation) contact.budget.add({ErrorTerm::kModulus, TermKind::kDeviation, *log_deviation});
}

}  // namespace teletact::service
