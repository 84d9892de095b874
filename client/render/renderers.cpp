#include "client/render/renderers.h"

#include <stdexcept>

#include "client/render/hold_renderer.h"
#include "client/render/interpolating_renderer.h"
#include "client/render/kalman_renderer.h"

namespace teletact::client {

const std::vector<std::string>& renderer_names() {
  static const std::vector<std::string> names{"kalman", "kalman-force", "interpolate", "hold"};
  return names;
}

std::unique_ptr<Renderer> make_renderer(const std::string& name, double servo_period_s) {
  KalmanOptions options;
  options.servo_period_s = servo_period_s;
  options.use_tangent = name != "kalman-force";
  if (name == "kalman" || name == "kalman-force") return std::make_unique<KalmanRenderer>(options);
  if (name == "interpolate") return std::make_unique<InterpolatingRenderer>();
  if (name == "hold") return std::make_unique<HoldRenderer>();
  std::string known;
  for (const std::string& one : renderer_names()) known += (known.empty() ? "" : ", ") + one;
  throw std::invalid_argument("unknown renderer '" + name + "'; known: " + known);
}

}  // namespace teletact::client
