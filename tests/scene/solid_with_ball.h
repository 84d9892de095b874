// A solid with a hard ball, for the tests of scenes.
#pragma once

#include <cmath>

#include "service/touch_plane/touch_session.h"
#include "tests/scene/stacks.h"
#include "tests/solver/block_stencil.h"

namespace teletact::service {

// 24 x 12 columns of 2 x 3 mm; a hard ball under (kBallX, kBallZ).
inline ExplicitModulus with_ball() {
  ExplicitModulus e;
  for (int i = 0; i <= 24; ++i) e.x_m.push_back(kWidthM * i / 24);
  for (int j = 0; j <= 10; ++j) e.y_m.push_back(kDepthM * j / 10);
  for (int k = 0; k <= 12; ++k) e.z_m.push_back(-0.018 + 0.003 * k);
  for (int k = 0; k < 12; ++k)
    for (int j = 0; j < 10; ++j)
      for (int i = 0; i < 24; ++i)
        e.youngs_modulus_pa.push_back(std::hypot(0.002 * (i + 0.5) - kBallX, 0.003 * (j + 0.5) - 0.009,
                                                 -0.018 + 0.003 * (k + 0.5) - kBallZ) < 0.006
                                          ? 8e4
                                          : 1e4);
  return e;
}

// What the session answers once the layer is ready; nobody prepares it here, so that is at once.
inline TouchAnswer touched(TouchSession& session, double x_m, double y_m, double z_m) {
  return session.solve({x_m, y_m, z_m});
}

}  // namespace teletact::service
