#include "bench/phantoms/metrics.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace teletact::bench {
namespace {

constexpr double kBorderM = 2e-3;  // of the image, where windows and kernels are cut
constexpr double kMinFraction = 0.6;

double x_of(const service::ImageGrid& g, std::size_t n) {
  return g.origin_x_m + static_cast<double>(n % g.nx) * g.dx_m;
}
double y_of(const service::ImageGrid& g, std::size_t n) {
  return g.origin_y_m + static_cast<double>(n / g.nx) * g.dy_m;
}

bool interior(const service::ImageGrid& g, std::size_t n) {
  const double right = 2 * g.origin_x_m + static_cast<double>(g.nx - 1) * g.dx_m;
  const double bottom = 2 * g.origin_y_m + static_cast<double>(g.ny - 1) * g.dy_m;
  const double x = x_of(g, n), y = y_of(g, n);
  return x >= kBorderM && x <= right - kBorderM && y >= kBorderM && y <= bottom - kBorderM;
}

double rms(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return values.empty() ? kNan : std::sqrt(sum / static_cast<double>(values.size()));
}

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return values.empty() ? kNan : sum / static_cast<double>(values.size());
}

double variance(const std::vector<double>& values) {
  const double m = mean(values);
  double sum = 0;
  for (const double v : values) sum += (v - m) * (v - m);
  return values.size() < 2 ? kNan : sum / static_cast<double>(values.size() - 1);
}

int half_nodes(double length_m, double step_m) {
  return std::max(1, static_cast<int>(std::lround((length_m / step_m - 1) / 2)));
}

// Sums of a plane fit in node units about the kernel's centre.
struct PlaneSums {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0, u = 0, xu = 0, yu = 0;
  void add(double dx, double dy, double value) {
    n += 1, x += dx, y += dy, xx += dx * dx, xy += dx * dy, yy += dy * dy;
    u += value, xu += dx * value, yu += dy * value;
  }
  double slope_y() const {
    const double cxx = xx - x * x / n, cxy = xy - x * y / n, cyy = yy - y * y / n;
    const double cxu = xu - x * u / n, cyu = yu - y * u / n, determinant = cxx * cyy - cxy * cxy;
    return determinant > 1e-9 * cxx * cyy ? (cxx * cyu - cxy * cxu) / determinant : kNan;
  }
};

// Of the strain: the estimate minus the truth, and the truth, over the nodes that `meant` picks.
struct Window {
  std::vector<double> estimate, error, truth;
  std::size_t nodes = 0;
  bool says_enough() const { return 2 * estimate.size() >= nodes && estimate.size() >= 8; }
};

template <class Meant>
Window window_of(const std::vector<double>& strain, const std::vector<double>& truth,
                 const service::ImageGrid& g, Meant&& meant) {
  Window w;
  for (std::size_t n = 0; n < strain.size(); ++n) {
    if (!meant(x_of(g, n), y_of(g, n))) continue;
    ++w.nodes;
    if (!std::isfinite(strain[n])) continue;
    w.estimate.push_back(strain[n]);
    w.error.push_back(strain[n] - truth[n]);
    w.truth.push_back(truth[n]);
  }
  return w;
}

}  // namespace

TrackErrors track_errors(const Track& t, const Phantom& p) {
  const double quarter_wave_m =
      p.geometry.sound_speed_m_s / p.geometry.center_frequency_hz / 4;  // T2.1: where peaks hop
  std::vector<double> axial, lateral;
  double nodes = 0, hops = 0;
  for (std::size_t n = 0; n < t.grid.size(); ++n) {
    if (!interior(t.grid, n)) continue;
    ++nodes;
    const Vector u = p.displacement_m(x_of(t.grid, n), y_of(t.grid, n));
    hops += !(std::abs(t.axial_m[n] - u.y) < quarter_wave_m);
    if (!t.valid[n]) continue;
    axial.push_back(t.axial_m[n] - u.y);
    if (!t.lateral_m.empty()) lateral.push_back(t.lateral_m[n] - u.x);
  }
  TrackErrors e;
  e.axial_rmse_m = rms(axial);
  e.bias_m = mean(axial);
  e.lateral_rmse_m = rms(lateral);
  e.valid_fraction = static_cast<double>(axial.size()) / nodes;
  e.hop_fraction = hops / nodes;
  for (double& a : axial) a = std::abs(a);
  std::sort(axial.begin(), axial.end());
  e.axial_max_m = axial.empty() ? kNan : axial.back();
  e.axial_p95_m =
      axial.empty() ? kNan : axial[static_cast<std::size_t>(0.95 * static_cast<double>(axial.size() - 1))];
  return e;
}

Calibration standardised_errors(const Track& t, const Phantom& p) {
  std::vector<double> inside, outside;
  const double margin = 2e-3 / p.diameter_m;  // 1 mm in radii
  for (std::size_t n = 0; n < t.std_m.size(); ++n) {
    if (!t.valid[n] || !interior(t.grid, n)) continue;
    const double x = x_of(t.grid, n), y = y_of(t.grid, n), radii = p.radii(x, y);
    const double z = (t.axial_m[n] - p.displacement_m(x, y).y) / t.std_m[n];
    if (radii < 1 - margin) inside.push_back(z);
    if (radii > 1 + margin) outside.push_back(z);
  }
  return {rms(inside), rms(outside)};
}

std::vector<double> axial_strain(const Track& t, double kernel_axial_m, double kernel_lateral_m) {
  const auto nx = static_cast<int>(t.grid.nx), ny = static_cast<int>(t.grid.ny);
  const int columns = half_nodes(kernel_lateral_m, t.grid.dx_m),
            rows = half_nodes(kernel_axial_m, t.grid.dy_m);
  std::vector<double> strain(t.grid.size(), kNan);
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) {
      PlaneSums sums;
      int inside = 0;
      for (int r = std::max(0, j - rows); r <= std::min(ny - 1, j + rows); ++r)
        for (int c = std::max(0, i - columns); c <= std::min(nx - 1, i + columns); ++c) {
          ++inside;
          const auto n = static_cast<std::size_t>(c + nx * r);
          if (t.valid[n]) sums.add(c - i, r - j, t.axial_m[n]);
        }
      if (sums.n >= 4 && sums.n >= kMinFraction * inside)
        strain[static_cast<std::size_t>(i + nx * j)] = sums.slope_y() / t.grid.dy_m;
    }
  return strain;
}

std::vector<double> true_axial_strain(const service::ImageGrid& g, const Phantom& p) {
  std::vector<double> truth(g.size());
  for (std::size_t n = 0; n < truth.size(); ++n) truth[n] = p.axial_strain(x_of(g, n), y_of(g, n));
  return truth;
}

StrainQuality strain_quality(const std::vector<double>& strain, const std::vector<double>& truth,
                             const service::ImageGrid& g, const Phantom& p) {
  constexpr double kGapM = 3e-3, kWidthM = 8e-3, kHalfHeightM = 4e-3;
  const double radius_m = p.diameter_m / 2;
  const Window background = window_of(strain, truth, g, [&](double x, double y) {
    const double beside = std::abs(x - p.inclusion_x_m) - radius_m - kGapM;
    return beside >= 0 && beside <= kWidthM && std::abs(y - p.inclusion_y_m) <= kHalfHeightM;
  });
  const Window target = window_of(strain, truth, g, [&](double x, double y) { return p.radii(x, y) <= 0.6; });
  std::vector<double> errors;
  for (std::size_t n = 0; n < strain.size(); ++n)
    if (std::isfinite(strain[n]) && interior(g, n)) errors.push_back(strain[n] - truth[n]);
  StrainQuality q{kNan, kNan, rms(errors), kNan};
  if (!background.says_enough()) return q;
  q.snre = std::abs(mean(background.truth)) / std::sqrt(variance(background.error));
  q.bias = mean(background.estimate) / mean(background.truth) - 1;
  if (target.says_enough())
    q.cnre = std::sqrt(2 * std::pow(mean(target.estimate) - mean(background.estimate), 2) /
                       (variance(target.error) + variance(background.error)));
  return q;
}

std::vector<std::uint8_t> judged_nodes(const std::vector<std::vector<float>>& maps,
                                       const service::ImageGrid& g, const Phantom& p) {
  constexpr double kAlwaysRadii = 1.3;
  std::vector<std::uint8_t> judged(g.size());
  for (std::size_t n = 0; n < judged.size(); ++n)
    judged[n] = p.radii(x_of(g, n), y_of(g, n)) <= kAlwaysRadii ||
                std::all_of(maps.begin(), maps.end(), [n](const auto& map) { return std::isfinite(map[n]); });
  return judged;
}

ModulusQuality modulus_quality(const std::vector<float>& modulus, const service::ImageGrid& g,
                               const Phantom& p, const std::vector<std::uint8_t>& judged) {
  constexpr double kInner = 0.7, kApartM = 3e-3;
  const auto says = [&](std::size_t n) {
    return (judged.empty() || judged[n] != 0) && std::isfinite(modulus[n]) && modulus[n] > 0;
  };
  std::vector<double> inner, background, logs;
  std::size_t finite = 0;
  for (std::size_t n = 0; n < modulus.size(); ++n) {
    finite += std::isfinite(modulus[n]);
    if (!says(n)) continue;
    const double radii = p.radii(x_of(g, n), y_of(g, n));
    logs.push_back(std::log(modulus[n]));
    if (radii <= kInner) inner.push_back(modulus[n]);
    if ((radii - 1) * p.diameter_m / 2 >= kApartM) background.push_back(modulus[n]);
  }
  ModulusQuality q;
  q.background = median_of(background);
  q.contrast = median_of(inner) / q.background;
  q.valid_fraction = static_cast<double>(finite) / static_cast<double>(modulus.size());
  const double threshold = otsu_threshold(logs);
  double both = 0, said = 0, truly = 0;
  for (std::size_t n = 0; n < modulus.size(); ++n) {
    const bool inside = p.radii(x_of(g, n), y_of(g, n)) <= 1;
    const bool beyond = says(n) && (std::log(modulus[n]) > threshold) == (p.contrast > 1);
    both += inside && beyond, said += beyond, truly += inside;
  }
  q.dice = 2 * both / (said + truly);
  return q;
}

double otsu_threshold(const std::vector<double>& values) {
  std::vector<double> sorted(values);
  std::sort(sorted.begin(), sorted.end());
  double total = 0;
  for (const double v : sorted) total += v;
  double best = -1, threshold = kNan, below = 0;
  const auto count = static_cast<double>(sorted.size());
  for (std::size_t k = 0; k + 1 < sorted.size(); ++k) {
    below += sorted[k];
    const double n = static_cast<double>(k + 1), rest = count - n;
    const double between = n * rest * std::pow(below / n - (total - below) / rest, 2);
    if (between > best) best = between, threshold = (sorted[k] + sorted[k + 1]) / 2;
  }
  return threshold;
}

Interval interval95(const std::vector<double>& values) {
  constexpr std::array<double, 30> kT{12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228,
                                      2.201,  2.179, 2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086,
                                      2.080,  2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042};
  const std::size_t n = values.size();
  if (n < 2) return {mean(values), kNan};
  const double t = n - 2 < kT.size() ? kT[n - 2] : 1.96;
  return {mean(values), t * std::sqrt(variance(values) / static_cast<double>(n))};
}

}  // namespace teletact::bench
