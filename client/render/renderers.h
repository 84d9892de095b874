// Renderers by name.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "client/render/force_limits.h"
#include "client/render/renderer.h"

namespace teletact::client {

// That render what answers tell: kalman (force and tangent), kalman-force (the source paper's), interpolate,
// hold.
const std::vector<std::string>& renderer_names();
// These, and law: the tissue's contact law, which a link has to bring; without one it is the Kalman filter.
const std::vector<std::string>& touch_renderer_names();

// Throws std::invalid_argument listing the known names.
// `limits`: of the display.
std::unique_ptr<Renderer> make_renderer(const std::string& name, double servo_period_s,
                                        const ForceLimits& limits = {});

}  // namespace teletact::client
