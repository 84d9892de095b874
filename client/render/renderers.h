// Renderers by name.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "client/render/force_limits.h"
#include "client/render/renderer.h"

namespace teletact::client {

// law (the tissue's contact law, kalman where there is none), kalman (force and tangent), kalman-force (the
// source paper's), interpolate, hold.
const std::vector<std::string>& renderer_names();

// Throws std::invalid_argument listing the known names.
// `limits`: of the display.
std::unique_ptr<Renderer> make_renderer(const std::string& name, double servo_period_s,
                                        const ForceLimits& limits = {});

}  // namespace teletact::client
