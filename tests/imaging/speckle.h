// Synthetic RF of random scatterers moved by a given displacement: the tests' own, so that what they claim
// rests on no other code. Gaussian-modulated cosine axially, Gaussian laterally, summed scatterer by
// scatterer in double.
#pragma once

#include <cmath>
#include <cstddef>
#include <functional>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "service/imaging/tracking/frame.h"

namespace teletact::service {

struct SpeckleOptions {
  std::size_t samples = 640, lines = 48;
  double fractional_bandwidth = 0.6;  // -6 dB, of the centre frequency
  double lateral_fwhm_m = 0.42e-3;
  double scatterers_per_mm2 = 120;
  double snr_db = 1e3;     // white noise
  double correlation = 1;  // rho: part of the echo that stays the same
  unsigned seed = 1;
};

inline AcquisitionGeometry speckle_geometry() {
  AcquisitionGeometry g;
  g.center_frequency_hz = 7.3e6;
  g.sampling_frequency_hz = 40e6;
  g.line_pitch_m = 0.235e-3;
  return g;
}

// (lateral, axial) displacement in metres of the tissue at (x, y); x from the first line's left border.
using Motion = std::function<std::pair<double, double>(double x_m, double y_m)>;

class Speckle {
 public:
  explicit Speckle(SpeckleOptions o) : options_(o), geometry_(speckle_geometry()) {
    const double width = static_cast<double>(o.lines) * geometry_.line_pitch_m, margin = 2e-3;
    const double depth = static_cast<double>(o.samples) * geometry_.sample_pitch_m();
    std::mt19937_64 random(o.seed);
    std::uniform_real_distribution<double> x(-margin, width + margin), y(-margin, depth + margin);
    std::normal_distribution<double> amplitude;
    const auto count =
        static_cast<std::size_t>(o.scatterers_per_mm2 * 1e6 * (width + 2 * margin) * (depth + 2 * margin));
    for (std::size_t n = 0; n < count; ++n) points_.push_back({x(random), y(random), amplitude(random)});
  }

  // The frame after `motion`; `noise_seed` differs between the frames of a pair.
  RfFrame frame(const Motion& motion, unsigned noise_seed) const {
    std::vector<double> image = echoes(points_, motion);
    std::mt19937_64 random(noise_seed * 7919u + options_.seed);
    std::normal_distribution<double> normal;
    double power = 0;
    for (const double v : image) power += v * v / static_cast<double>(image.size());
    if (options_.correlation < 1) {  // a * common + sqrt(1 - a^2) * own: the pair correlates by a^2 = rho
      auto own = points_;
      for (auto& p : own) p.amplitude = normal(random);
      const std::vector<double> other = echoes(own, motion);
      const double a = std::sqrt(options_.correlation), b = std::sqrt(1 - options_.correlation);
      for (std::size_t n = 0; n < image.size(); ++n) image[n] = a * image[n] + b * other[n];
    }
    const double sigma = std::sqrt(power) * std::pow(10, -options_.snr_db / 20);
    RfFrame out{options_.samples, options_.lines, std::vector<float>(image.size())};
    for (std::size_t n = 0; n < image.size(); ++n)
      out.samples[n] = static_cast<float>(100 / std::sqrt(power) * (image[n] + sigma * normal(random)));
    return out;
  }

  const AcquisitionGeometry& geometry() const { return geometry_; }

 private:
  struct Point {
    double x, y, amplitude;
  };

  std::vector<double> echoes(const std::vector<Point>& points, const Motion& motion) const {
    const auto lines = static_cast<std::ptrdiff_t>(options_.lines),
               samples = static_cast<std::ptrdiff_t>(options_.samples);
    const double pitch = geometry_.line_pitch_m, step = geometry_.sample_pitch_m();
    // Round trip: the carrier's spatial period is c / (2 f0); envelope sigma from the -6 dB bandwidth.
    const double wave = 4 * std::numbers::pi * geometry_.center_frequency_hz / geometry_.sound_speed_m_s;
    const double spectral = options_.fractional_bandwidth * wave / (2 * std::sqrt(2 * std::log(2.0)));
    const double axial = 1 / spectral, lateral = options_.lateral_fwhm_m / (2 * std::sqrt(2 * std::log(2.0)));
    const auto reach_k = static_cast<std::ptrdiff_t>(4 * axial / step) + 1,
               reach_l = static_cast<std::ptrdiff_t>(3 * lateral / pitch) + 1;
    std::vector<double> image(options_.lines * options_.samples, 0.0),
        pulse(static_cast<std::size_t>(2 * reach_k + 1));
    for (const Point& p : points) {
      const auto [ux, uy] = motion(p.x, p.y);
      const double x = (p.x + ux) / pitch - 0.5, y = (p.y + uy) / step;
      const auto l0 = std::lround(x), k0 = std::lround(y);
      if (k0 + reach_k < 0 || k0 - reach_k >= samples || l0 + reach_l < 0 || l0 - reach_l >= lines) continue;
      for (std::ptrdiff_t k = -reach_k; k <= reach_k; ++k) {
        const double d = (static_cast<double>(k0 + k) - y) * step;
        pulse[static_cast<std::size_t>(k + reach_k)] =
            p.amplitude * std::exp(-0.5 * d * d / (axial * axial)) * std::cos(wave * d);
      }
      for (std::ptrdiff_t l = std::max<std::ptrdiff_t>(l0 - reach_l, 0);
           l <= std::min(l0 + reach_l, lines - 1); ++l) {
        const double d = (static_cast<double>(l) - x) * pitch,
                     weight = std::exp(-0.5 * d * d / (lateral * lateral));
        for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(k0 - reach_k, 0);
             k <= std::min(k0 + reach_k, samples - 1); ++k)
          image[static_cast<std::size_t>(k + samples * l)] +=
              weight * pulse[static_cast<std::size_t>(k - k0 + reach_k)];
      }
    }
    return image;
  }

  SpeckleOptions options_;
  AcquisitionGeometry geometry_;
  std::vector<Point> points_;
};

}  // namespace teletact::service
