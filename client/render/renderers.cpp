#include "client/render/renderers.h"

#include <stdexcept>

#include "client/render/kalman_renderer.h"
#include "client/render/law_renderer.h"

namespace teletact::client {

const std::vector<std::string>& renderer_names() {
  static const std::vector<std::string> names{"law", "kalman"};
  return names;
}

std::unique_ptr<Renderer> make_renderer(const std::string& name, double servo_period_s,
                                        const ForceLimits& limits) {
  KalmanOptions options;
  options.blend.servo_period_s = servo_period_s;
  if (name == "law")
    return std::make_unique<LawRenderer>(
        LawRendererOptions{.kalman = options,
                           .largest_force_n = limits.largest_force_n,
                           .largest_stiffness_n_m = limits.largest_stiffness_n_m});
  if (name == "kalman") return std::make_unique<KalmanRenderer>(options);
  throw std::invalid_argument("unknown renderer '" + name + "'; known: law, kalman");
}

}  // namespace teletact::client
