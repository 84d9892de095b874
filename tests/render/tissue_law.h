// The contact law of an AnalyticTissue: columns every 2 mm.
#pragma once

#include <cmath>

#include "client/render/near_law.h"
#include "tests/render/analytic_tissue.h"

namespace teletact::client::test {

inline NearLaw law_of(const AnalyticTissue& tissue, std::uint64_t version, double begin_m, double end_m) {
  NearLaw law;
  for (double x = begin_m; x < end_m + 1e-9; x += 0.002) {
    LawColumn& column = law.columns[law.count++];
    column.x_m = x;
    column.version = version;
    column.error_share = 0.005F, column.error_n = 0.001F;
    const ForceSample one = tissue.answer({x, tissue.surface_m + 1, 0});
    const double k = -one.force_n.y() / 2.5, slope = -one.force_n.x();
    for (const double d : {3e-4, 9e-4, 2.7e-3, 8e-3}) {
      column.log_depth[column.rows] = float(std::log(d));
      column.samples[column.rows++] = {float(std::log(k) + 2.5 * std::log(d)), float(slope / k), 2.5F, 0};
    }
  }
  return law;
}

}  // namespace teletact::client::test
