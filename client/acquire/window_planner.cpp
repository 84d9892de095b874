#include "client/acquire/window_planner.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace teletact::client {

WindowPlanner::WindowPlanner(const PlannerOptions& options, double start_x_m, int direction)
    : options_(options), x_m_(start_x_m), direction_(direction < 0 ? -1 : 1) {
  if (options.window_count == 0)
    throw std::invalid_argument("planner: the tissue is narrower than one window");
  if (!(options.window_width_m > 0)) throw std::invalid_argument("planner: the window width must be above 0");
}

std::optional<std::size_t> WindowPlanner::next(const FingerMotion& finger,
                                               const std::vector<WindowKnowledge>& windows, double now_s) {
  if (finger.present) {
    x_m_ = finger.x_m;
    if (std::abs(finger.velocity_m_s) > options_.still_m_s) direction_ = finger.velocity_m_s < 0 ? -1 : 1;
  }
  if (finger.wished_m) {
    const std::size_t wished = window_at(*finger.wished_m);
    const WindowKnowledge& window = windows.at(wished);
    if (window.frames_left > 0 && (!window.acquired_s || stale(window, now_s))) return wished;
  }
  const double soon_m = x_m_ + direction_ * options_.link_s * std::abs(finger.velocity_m_s);
  const auto [near, far] = std::minmax({window_at(x_m_), window_at(soon_m)});
  const std::vector<std::size_t> path = path_ahead(options_.lookahead + far - near);
  for (std::size_t window : path)
    if (!windows.at(window).acquired_s && windows[window].frames_left > 0) return window;
  if (const auto other = options_.all ? nearest_unknown(windows) : std::nullopt) return other;
  if (!finger.present) return std::nullopt;  // nothing grows stale before anybody touches
  // A renewal may not delay a window that the finger has never seen, so all that lies ahead must be known.
  const std::vector<std::size_t> all_ahead = path_ahead(options_.window_count);
  for (std::size_t window : all_ahead)
    if (!windows[window].acquired_s && windows[window].frames_left > 0) return std::nullopt;
  for (std::size_t i = 1; i < all_ahead.size(); ++i) {
    const WindowKnowledge& window = windows[all_ahead[i]];
    if (stale(window, now_s) && window.frames_left > 0 &&
        arrival_s(finger, all_ahead[i]) > options_.renewal_lead_s)
      return all_ahead[i];
  }
  return std::nullopt;
}

std::optional<std::size_t> WindowPlanner::nearest_unknown(const std::vector<WindowKnowledge>& windows) const {
  const auto away_m = [this](std::size_t window) {
    return std::abs(window_x_m(window) + options_.window_width_m / 2 - x_m_);
  };
  std::optional<std::size_t> nearest;
  for (std::size_t window = 0; window < windows.size(); ++window)
    if (!windows[window].acquired_s && windows[window].frames_left > 0 &&
        (!nearest || away_m(window) < away_m(*nearest)))
      nearest = window;
  return nearest;
}

std::size_t WindowPlanner::window_at(double x_m) const {
  const double index = std::floor(x_m / options_.window_width_m);
  return static_cast<std::size_t>(std::clamp(index, 0.0, static_cast<double>(options_.window_count - 1)));
}

bool WindowPlanner::stale(const WindowKnowledge& window, double now_s) const {
  return window.acquired_s && now_s - *window.acquired_s > options_.refresh_after_s;
}

double WindowPlanner::arrival_s(const FingerMotion& finger, std::size_t window) const {
  const double border_m = window_x_m(direction_ > 0 ? window : window + 1);
  return std::abs(border_m - finger.x_m) / std::max(std::abs(finger.velocity_m_s), options_.still_m_s);
}

std::vector<std::size_t> WindowPlanner::path_ahead(std::size_t lookahead) const {
  std::vector<std::size_t> path{window_at(x_m_)};
  const auto last = static_cast<std::ptrdiff_t>(options_.window_count) - 1;
  auto window = static_cast<std::ptrdiff_t>(path.front());
  for (std::size_t i = 0; i < lookahead; ++i) {
    window += direction_;
    if (window < 0 || window > last) break;
    path.push_back(static_cast<std::size_t>(window));
  }
  return path;
}

}  // namespace teletact::client
