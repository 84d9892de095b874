// Renderers by name.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "client/render/force_limits.h"
#include "client/render/renderer.h"

namespace teletact::client {

// law: the tissue's contact law, which a link has to bring; without one it is the Kalman filter. kalman: that
// filter, of what answers tell (force and tangent).
const std::vector<std::string>& renderer_names();

// Throws std::invalid_argument listing the known names.
// `limits`: of the display.
std::unique_ptr<Renderer> make_renderer(const std::string& name, double servo_period_s,
                                        const ForceLimits& limits = {});

}  // namespace teletact::client
