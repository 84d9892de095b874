#include "client/render/renderers.h"

#include <stdexcept>

#include "client/render/hold_renderer.h"
#include "client/render/interpolating_renderer.h"
#include "client/render/kalman_renderer.h"
#include "client/render/law_renderer.h"

namespace teletact::client {

const std::vector<std::string>& renderer_names() {
  static const std::vector<std::string> names{"kalman", "kalman-force", "interpolate", "hold"};
  return names;
}

const std::vector<std::string>& touch_renderer_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all = renderer_names();
    all.insert(all.begin(), "law");
    return all;
  }();
  return names;
}

std::unique_ptr<Renderer> make_renderer(const std::string& name, double servo_period_s,
                                        const ForceLimits& limits) {
  KalmanOptions options;
  options.blend.servo_period_s = servo_period_s;
  options.use_tangent = name != "kalman-force";
  if (name == "law")
    return std::make_unique<LawRenderer>(
        LawRendererOptions{.kalman = options,
                           .largest_force_n = limits.largest_force_n,
                           .largest_stiffness_n_m = limits.largest_stiffness_n_m});
  if (name == "kalman" || name == "kalman-force") return std::make_unique<KalmanRenderer>(options);
  if (name == "interpolate") return std::make_unique<InterpolatingRenderer>();
  if (name == "hold") return std::make_unique<HoldRenderer>();
  std::string known;
  for (const std::string& one : touch_renderer_names()) known += (known.empty() ? "" : ", ") + one;
  throw std::invalid_argument("unknown renderer '" + name + "'; known: " + known);
}

}  // namespace teletact::client
