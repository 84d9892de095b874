#include <algorithm>

#include "service/scene/scene.h"

namespace teletact::service {

std::shared_ptr<const WindowModel> SceneSnapshot::window_at(double x_m, std::uint64_t current,
                                                            double hysteresis_m) const {
  std::shared_ptr<const WindowModel> best;
  double best_margin_m = -1;
  for (const auto& window : windows) {
    if (x_m < window->region.begin_x_m || x_m >= window->region.end_x_m) continue;
    const double margin_m = std::min(x_m - window->region.begin_x_m, window->region.end_x_m - x_m);
    if (margin_m > best_margin_m) best = window, best_margin_m = margin_m;
  }
  if (!best) return nullptr;
  for (const auto& window : windows)
    if (window->id == current && x_m >= window->region.begin_x_m - hysteresis_m &&
        x_m < window->region.end_x_m + hysteresis_m)
      return window;
  return best;
}

bool adjoin(const WindowModel& a, const WindowModel& b) {
  return a.region.begin_x_m - Scene::kSameWindowM < b.region.end_x_m &&
         a.region.end_x_m + Scene::kSameWindowM > b.region.begin_x_m;
}

bool SceneSnapshot::lone(const WindowModel& window) const {
  return map && std::none_of(windows.begin(), windows.end(), [&window](const auto& other) {
           return other->id != window.id && adjoin(*other, window);
         });
}

std::vector<std::string_view> SceneSnapshot::flags_of(const WindowModel& window) const {
  std::vector<std::string_view> flags;
  if (window.evidence)
    for (const std::string& warning : window.evidence->warnings) flags.push_back(flag_of(warning));
  if (lone(window)) flags.emplace_back(name_of(WarningFlag::kLone));
  return flags;
}

Region SceneSnapshot::covered_around(double x_m) const {
  constexpr double kAdjoiningM = 1e-6;  // rounding of positions and widths
  Region covered{x_m, x_m};
  bool inside = false;
  double begin_m = 0, end_m = 0;
  for (const auto& window : windows) {
    if (windows.front() == window || window->region.begin_x_m > end_m + kAdjoiningM)
      begin_m = window->region.begin_x_m, end_m = begin_m;
    end_m = std::max(end_m, window->region.end_x_m);
    inside = x_m >= begin_m && x_m < end_m;
    if (inside) covered = {begin_m, end_m, window->region.z};
  }
  return covered;
}

}  // namespace teletact::service
