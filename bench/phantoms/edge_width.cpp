// The blur of a strain image: the true strain convolved with Gaussians, compared around the inclusion.
#include <algorithm>
#include <cmath>
#include <limits>

#include "bench/phantoms/metrics.h"

namespace teletact::bench {
namespace {

constexpr double kStepM = 0.2e-3;           // of the true strain's samples
constexpr double kReach = 3;                // of the Gaussian, standard deviations
constexpr double kWidthOfSigma = 1.683242;  // 20-80 % of an error function

// `count` samples from begin_m on.
struct Axis {
  double begin_m = 0;
  int count = 0;
  double at(int k) const { return begin_m + k * kStepM; }
};

std::vector<double> gaussian(double sigma_m) {
  const int half = static_cast<int>(std::ceil(kReach * sigma_m / kStepM));
  std::vector<double> taps;
  double sum = 0;
  for (int k = -half; k <= half; ++k) {
    taps.push_back(std::exp(-0.5 * std::pow(k * kStepM / std::max(sigma_m, 1e-9), 2)));
    sum += taps.back();
  }
  for (double& t : taps) t /= sum;
  return taps;
}

// Along one axis of an nx x ny image; its border continues.
std::vector<double> blurred(const std::vector<double>& image, int nx, int ny, double sigma_m, bool axially) {
  const std::vector<double> taps = gaussian(sigma_m);
  const int half = static_cast<int>(taps.size() / 2);
  std::vector<double> out(image.size(), 0.0);
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i)
      for (int k = -half; k <= half; ++k) {
        const int c = axially ? i : std::clamp(i + k, 0, nx - 1),
                  r = axially ? std::clamp(j + k, 0, ny - 1) : j;
        out[static_cast<std::size_t>(i + nx * j)] +=
            taps[static_cast<std::size_t>(k + half)] * image[static_cast<std::size_t>(c + nx * r)];
      }
  return out;
}

struct Sample {
  std::size_t node, pixel;  // the nearest pixel: kStepM / 2 off at most
};

class Fit {
 public:
  Fit(const std::vector<double>& strain, const service::ImageGrid& g, const Phantom& p) : strain_(strain) {
    const double reach = 0.9 * p.diameter_m + 1.5e-3;
    x_ = {std::max(1e-3, p.inclusion_x_m - reach - 3e-3), 0};
    y_ = {std::max(1e-3, p.inclusion_y_m - reach - 3e-3), 0};
    x_.count = static_cast<int>((p.inclusion_x_m + reach + 3e-3 - x_.begin_m) / kStepM) + 1;
    y_.count = static_cast<int>((p.inclusion_y_m + reach + 3e-3 - y_.begin_m) / kStepM) + 1;
    for (int j = 0; j < y_.count; ++j)
      for (int i = 0; i < x_.count; ++i) truth_.push_back(p.axial_strain(x_.at(i), y_.at(j)));
    for (std::size_t n = 0; n < strain.size(); ++n) {
      const double x = g.origin_x_m + static_cast<double>(n % g.nx) * g.dx_m;
      const double y = g.origin_y_m + static_cast<double>(n / g.nx) * g.dy_m;
      if (!std::isfinite(strain[n]) || std::abs(x - p.inclusion_x_m) > reach ||
          std::abs(y - p.inclusion_y_m) > reach || y < 2e-3)
        continue;
      const auto i = std::lround((x - x_.begin_m) / kStepM), j = std::lround((y - y_.begin_m) / kStepM);
      samples_.push_back({n, static_cast<std::size_t>(i + x_.count * j)});
    }
  }

  bool usable() const { return samples_.size() >= 50; }

  // The true strain blurred along one axis.
  std::vector<double> truth(double sigma_m, bool axially) const { return blur(truth_, sigma_m, axially); }
  std::vector<double> blur(const std::vector<double>& image, double sigma_m, bool axially) const {
    return blurred(image, x_.count, y_.count, sigma_m, axially);
  }

  // Sum of squares of strain - (a + b image) for the best a, b: an estimator's bias is no blur.
  double misfit(const std::vector<double>& image) const {
    double n = 0, s = 0, ss = 0, e = 0, ee = 0, se = 0;
    for (const Sample& sample : samples_) {
      const double t = image[sample.pixel], v = strain_[sample.node];
      n += 1, s += t, ss += t * t, e += v, ee += v * v, se += t * v;
    }
    const double cov = se - s * e / n, var = ss - s * s / n;
    return ee - e * e / n - cov * cov / var;
  }

 private:
  const std::vector<double>& strain_;
  Axis x_, y_;
  std::vector<double> truth_;
  std::vector<Sample> samples_;
};

// Minimum over sigma in [0, 2.5] mm by a scan and golden sections.
template <class Misfit>
double best_sigma(Misfit&& misfit) {
  constexpr double kMaxM = 2.5e-3, kScanM = 0.25e-3, kGolden = 0.618034;
  double best = 0, least = misfit(0.0);
  for (double s = kScanM; s <= kMaxM; s += kScanM)
    if (const double m = misfit(s); m < least) least = m, best = s;
  double low = std::max(0.0, best - kScanM), high = best + kScanM;
  while (high - low > 20e-6) {
    const double a = high - kGolden * (high - low), b = low + kGolden * (high - low);
    if (misfit(a) < misfit(b))
      high = b;
    else
      low = a;
  }
  return (low + high) / 2;
}

}  // namespace

EdgeWidth edge_width(const std::vector<double>& strain, const service::ImageGrid& g, const Phantom& p) {
  const Fit fit(strain, g, p);
  if (p.contrast == 1 || !fit.usable()) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    return {nan, nan};
  }
  double axial = 0, lateral = 0.5e-3;
  for (int round = 0; round < 2; ++round) {
    const auto across = fit.truth(lateral, false);
    axial = best_sigma([&](double s) { return fit.misfit(fit.blur(across, s, true)); });
    const auto along = fit.truth(axial, true);
    lateral = best_sigma([&](double s) { return fit.misfit(fit.blur(along, s, false)); });
  }
  return {kWidthOfSigma * axial, kWidthOfSigma * lateral};
}

}  // namespace teletact::bench
