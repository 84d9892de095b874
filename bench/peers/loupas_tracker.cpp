// Phase tracking: Loupas, Powers, Gill 1995, "An axial velocity estimator for ultrasound blood flow imaging,
// based on a full evaluation of the Doppler equation by means of a two-dimensional autocorrelation approach",
// IEEE TUFFC 42(4):672-688, doi 10.1109/58.393110: shift = phase of the autocorrelation from frame to frame
// over that from sample to sample, both averaged over the window. A phase is ambiguous beyond a quarter
// wavelength, so each row starts from the whole-sample shift of the row above, as phase-root seeking does
// (Pesavento et al. 1999, doi 10.1109/58.796111); the probe's face rests. Axial only.
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "bench/basics/median.h"
#include "bench/peers/rf_nodes.h"

namespace teletact::bench {
namespace {

using reference::RfImage;
using Complex = std::complex<double>;

// The analytic signal of the band around the centre frequency, zero outside.
class Analytic {
 public:
  Analytic(const RfImage& rf, double periods_per_sample)
      : samples_(rf.samples), lines_(rf.lines), values_(rf.values.size()) {
    const int half = std::max(1, static_cast<int>(std::lround(1.5 / periods_per_sample)));
    std::vector<Complex> taps;  // Hann low-pass, moved to the centre frequency
    for (int k = -half; k <= half; ++k)
      taps.push_back(std::polar(.5 + .5 * std::cos(std::numbers::pi * k / (half + 1)),
                                2 * std::numbers::pi * periods_per_sample * k));
    for (int l = 0; l < lines_; ++l)
      for (int k = 0; k < samples_; ++k) {
        Complex sum = 0;
        for (int t = -half; t <= half; ++t) sum += taps[static_cast<std::size_t>(t + half)] * rf.at(k - t, l);
        values_[static_cast<std::size_t>(k + samples_ * l)] = sum;
      }
  }
  Complex at(int k, int l) const {
    const bool inside = k >= 0 && k < samples_ && l >= 0 && l < lines_;
    return inside ? values_[static_cast<std::size_t>(k + samples_ * l)] : 0;
  }

 private:
  int samples_, lines_;
  std::vector<Complex> values_;
};

// Median of the five nearest nodes of the row above.
double above(const Nodes& nodes, const LagField& field, int i, int j) {
  std::vector<double> row;
  for (int c = std::max(0, i - 2); c <= std::min(nodes.grid.nx - 1, i + 2); ++c)
    row.push_back(field.axial[nodes.at(c, j - 1)]);
  return median_of(std::move(row));
}

void refine(const Analytic& pre, const Analytic& post, int sample, int line, const reference::Window& window,
            double& shift, double& correlation) {
  const int lag = static_cast<int>(std::lround(shift));
  Complex between = 0, along = 0;
  double pre_energy = 0, post_energy = 0;
  for (int l = line - window.half_lateral; l <= line + window.half_lateral; ++l)
    for (int k = sample - window.half_axial; k <= sample + window.half_axial; ++k) {
      const Complex a = pre.at(k, l), b = post.at(k + lag, l);
      between += std::conj(a) * b;
      along += std::conj(a) * pre.at(k + 1, l) + std::conj(b) * post.at(k + lag + 1, l);
      pre_energy += std::norm(a);
      post_energy += std::norm(b);
    }
  if (!(pre_energy > 0 && post_energy > 0)) return;
  // post(k + lag) = pre(k + lag - u): its phase is ahead by (lag - u) times that of one sample.
  shift = lag - std::arg(between) / std::arg(along);
  correlation = std::abs(between) / std::sqrt(pre_energy * post_energy);
}

Track by_autocorrelation(const TrackerOptions& options, const service::RfFrame& pre_frame,
                         const service::RfFrame& post_frame, const service::AcquisitionGeometry& geometry) {
  const Nodes nodes(pre_frame, geometry, options.grid_dx_m, options.grid_dy_m);
  const double periods = geometry.center_frequency_hz / geometry.sampling_frequency_hz;
  const Analytic pre(image_of(pre_frame), periods), post(image_of(post_frame), periods);
  const reference::Window window = nodes.window(options.window_axial_m, options.window_lateral_m);
  LagField field(nodes.image.size());
  for (int j = 0; j < nodes.grid.ny; ++j)
    for (int i = 0; i < nodes.grid.nx; ++i) {
      const std::size_t n = nodes.at(i, j);
      field.axial[n] = j > 0 ? above(nodes, field, i, j) : 0;
      for (int pass = 0; pass < 2; ++pass)
        refine(pre, post, nodes.sample(j), nodes.line(i), window, field.axial[n], field.correlation[n]);
    }
  Track t = track_of(nodes, field, options.min_correlation);
  t.lateral_m.clear();
  return t;
}

}  // namespace

Tracker make_loupas_tracker(TrackerOptions options) {
  return {"2-D autocorrelation (Loupas)", std::bind_front(by_autocorrelation, options)};
}

}  // namespace teletact::bench
