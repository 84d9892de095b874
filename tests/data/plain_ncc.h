// What the tracking of recorded pairs is compared with.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "service/imaging/estimate.h"
#include "tests/data/recorded_pairs.h"
#include "tests/reference/ncc.h"

namespace teletact::service {

// Plain NCC of the README: 121 samples x 7 lines, whole search range, parabolic peak, 5 x 5 median, on the
// nodes of `grid` that the figures need.
inline std::vector<float> plain_ncc(const RecordedPair& pair, const SampleGrid& grid) {
  const auto image = [](const RfFrame& f) {
    return reference::RfImage{static_cast<int>(f.sample_count),
                              static_cast<int>(f.line_count),
                              {f.samples.begin(), f.samples.end()}};
  };
  const reference::RfImage pre = image(pair.pre), post = image(pair.post);
  std::vector<float> field(2 * static_cast<std::size_t>(grid.nodes()), std::nanf(""));
  const auto needed = [](int sample) {
    return (sample > 700 && sample < 1500) || (sample > 1650 && sample < 2040);
  };
  for (int node = 0; node < grid.nodes(); ++node) {
    const int sample = grid.first_sample + node / grid.nx * grid.sample_step,
              line = grid.first_line + node % grid.nx * grid.line_step;
    if (needed(sample)) {
      const reference::Shift u = reference::ncc_peak(pre, post, sample, line, {60, 3, 1}, {-45, 5}, {-3, 3});
      field[2 * static_cast<std::size_t>(node)] = static_cast<float>(u.lines * pair.geometry.line_pitch_m);
      field[2 * static_cast<std::size_t>(node) + 1] =
          static_cast<float>(u.samples * pair.geometry.sample_pitch_m());
    }
  }
  return field;
}

// Axial component, 5 x 5 nodes; NaN stays.
inline std::vector<float> median_filtered(const std::vector<float>& field, const SampleGrid& grid) {
  std::vector<float> out = field;
  for (int j = 2; j + 2 < grid.ny; ++j)
    for (int i = 2; i + 2 < grid.nx; ++i) {
      std::vector<float> around;
      for (int n = -2; n <= 2; ++n)
        for (int m = -2; m <= 2; ++m)
          around.push_back(field[2 * static_cast<std::size_t>(i + m + grid.nx * (j + n)) + 1]);
      if (std::any_of(around.begin(), around.end(), [](float u) { return std::isnan(u); })) continue;
      std::nth_element(around.begin(), around.begin() + 12, around.end());
      out[2 * static_cast<std::size_t>(i + grid.nx * j) + 1] = around[12];
    }
  return out;
}

}  // namespace teletact::service
