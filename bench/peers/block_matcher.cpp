// Multi-level block matching after Shi & Varghese 2007, "Two-dimensional multi-level strain estimation for
// discontinuous tissue", Phys. Med. Biol. 52:389-401, doi 10.1088/0031-9155/52/2/006: the whole range on the
// envelope with large blocks, then RF with ever smaller blocks around the displacement of the level above,
// medians between the levels, parabolas at the end. Their levels, this chart's windows.
#include <algorithm>
#include <cmath>

#include "bench/peers/rf_nodes.h"

namespace teletact::bench {
namespace {

using reference::RfImage;
using reference::Window;

// Without its mean over the window that the envelope is compared in, so that correlation can tell lags apart.
RfImage without_mean(const RfImage& image, int half) {
  RfImage out = image;
  for (int l = 0; l < image.lines; ++l) {
    double sum = 0;
    for (int k = 0; k < std::min(half, image.samples); ++k) sum += image.at(k, l);
    for (int k = 0; k < image.samples; ++k) {
      sum += image.at(k + half, l) - image.at(k - half - 1, l);
      const int count = std::min(k + half, image.samples - 1) - std::max(k - half, 0) + 1;
      out.values[static_cast<std::size_t>(k + image.samples * l)] -= sum / count;
    }
  }
  return out;
}

LagField on_envelope(const TrackerOptions& options, const RfImage& pre, const RfImage& post,
                     const Nodes& nodes, const service::AcquisitionGeometry& geometry) {
  constexpr double kWindowAxialM = 4e-3, kWindowLateralM = 2e-3;
  constexpr int kDecimation = 4;  // of lags and samples: the envelope's correlation is about 10 samples wide
  const double periods = geometry.center_frequency_hz / geometry.sampling_frequency_hz;
  const Window window = nodes.window(kWindowAxialM, kWindowLateralM, kDecimation);
  const RfImage a = without_mean(envelope_of(pre, periods), window.half_axial),
                b = without_mean(envelope_of(post, periods), window.half_axial);
  const int lateral_reach = static_cast<int>(std::ceil(options.lateral_search_m / nodes.line_m));
  LagField field(nodes.image.size());
  for (int j = 0; j < nodes.grid.ny; ++j)
    for (int i = 0; i < nodes.grid.nx; ++i) {
      const std::size_t n = nodes.at(i, j);
      const double depth_m = geometry.first_sample_depth_m + nodes.sample(j) * nodes.sample_m;
      const int reach =  // a multiple, so that 0 is among the lags
          kDecimation *
          static_cast<int>(std::ceil(options.max_strain * depth_m / nodes.sample_m / kDecimation));
      for (int l = -lateral_reach; l <= lateral_reach; ++l)
        for (int k = -reach; k <= reach; k += kDecimation) {
          const double c =
              reference::normalised_cross_correlation(a, b, nodes.sample(j), nodes.line(i), window, k, l);
          if (c > field.correlation[n]) field.correlation[n] = c, field.axial[n] = k, field.lateral[n] = l;
        }
    }
  return field;
}

Track by_block_matching(const TrackerOptions& options, const service::RfFrame& pre_frame,
                        const service::RfFrame& post_frame, const service::AcquisitionGeometry& geometry) {
  constexpr double kCoarseM = 1.5e-3, kMiddleM = 0.8e-3;  // node spacing of the first two levels
  const Nodes coarse(pre_frame, geometry, kCoarseM, kCoarseM),
      middle(pre_frame, geometry, kMiddleM, kMiddleM),
      fine(pre_frame, geometry, options.grid_dx_m, options.grid_dy_m);
  const RfImage pre = image_of(pre_frame), post = image_of(post_frame);
  LagField field = on_envelope(options, pre, post, coarse, geometry);
  median_filter(coarse, 2, field);
  field = resampled(field, coarse, middle);
  const int half_period =
      static_cast<int>(std::ceil(geometry.sampling_frequency_hz / geometry.center_frequency_hz / 2));
  match_nodes(pre, post, middle, middle.window(1.5 * options.window_axial_m, 1.5 * options.window_lateral_m),
              2 * half_period, 1, field);
  median_filter(middle, 1, field);
  field = resampled(field, middle, fine);
  match_nodes(pre, post, fine, fine.window(options.window_axial_m, options.window_lateral_m), half_period - 1,
              1, field);
  return track_of(fine, field, options.min_correlation);
}

}  // namespace

Tracker make_block_matcher(TrackerOptions options) {
  return {"multi-level block matching", std::bind_front(by_block_matching, options)};
}

}  // namespace teletact::bench
