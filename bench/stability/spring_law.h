// The contact law (T7.1) of tissue in closed form, U(x, d) = 1/2 K(x) d^2.
#pragma once

#include <cmath>
#include <cstdint>

#include "client/render/near_law.h"
#include "client/render/renderer.h"

namespace teletact::bench {

// Columns from begin_m to end_m, as many as there is room for. `tissue`: ForceSample answer(position_m).
template <class Tissue>
client::NearLaw spring_law(const Tissue& tissue, double begin_m, double apart_m, double end_m,
                           std::uint64_t version) {
  client::NearLaw law;
  for (; law.count < client::NearLaw::kMax; ++law.count) {
    LawColumn& column = law.columns[law.count];
    column.x_m = begin_m + apart_m * static_cast<double>(law.count);
    if (column.x_m > end_m) break;
    column.version = version;
    column.error_share = 0.005F, column.error_n = 0.001F;
    const client::ForceSample at = tissue.answer({column.x_m, 1, 0});
    const double k = -at.force_n.y();
    for (const double depth_m : {1e-3, 0.04}) {
      const double s = std::log(depth_m);
      column.log_depth[column.rows] = static_cast<float>(s);
      column.samples[column.rows++] = {static_cast<float>(std::log(k / 2) + 2 * s),
                                       static_cast<float>(-2 * at.force_n.x() / k), 2, 0};
    }
  }
  return law;
}

}  // namespace teletact::bench
