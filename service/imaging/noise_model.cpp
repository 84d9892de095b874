#include "service/imaging/noise_model.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <numbers>

namespace teletact::service {
namespace {

// The gradients of data_term in refinement.cl.
constexpr double kAxial[] = {-1.0 / 60, 0.15, -0.75, 0, 0.75, -0.15, 1.0 / 60};
constexpr double kLateral[] = {1.0 / 12, -2.0 / 3, 0, 2.0 / 3, -1.0 / 12};
constexpr double kPassEdge = 0.26, kStopEdge = 0.32;  // of the sampling frequency
constexpr double kQuietest = 1e-3;                    // of a spectrum's peak: what lies below is not measured

// r at signed lags.
class Lags {
 public:
  Lags(const Autocorrelations& a, const std::vector<double>& r) : a_(a), r_(r) {}
  double at(int lag, int lateral) const {
    const int k = std::abs(lag), q = std::abs(lateral);
    return k < a_.lags && q < a_.laterals ? r_[static_cast<std::size_t>(k + a_.lags * q)] : 0;
  }
  double axial_gradient(int lag, int lateral) const {
    double sum = 0;
    for (int i = -3; i <= 3; ++i)
      for (int j = -3; j <= 3; ++j) sum += tap(i) * tap(j) * at(lag + i - j, lateral);
    return sum;
  }
  double lateral_gradient(int lag, int lateral) const {
    double sum = 0;
    for (int i = -2; i <= 2; ++i)
      for (int j = -2; j <= 2; ++j) sum += kLateral[i + 2] * kLateral[j + 2] * at(lag, lateral + i - j);
    return sum;
  }

 private:
  static double tap(int i) { return kAxial[i + 3]; }
  const Autocorrelations& a_;
  const std::vector<double>& r_;
};

double spectrum(const Autocorrelations& a, const std::vector<double>& r, double frequency) {
  double sum = r[0];
  for (int k = 1; k < a.lags; ++k)
    sum += (1 + std::cos(std::numbers::pi * k / a.lags)) * r[static_cast<std::size_t>(k)] *
           std::cos(2 * std::numbers::pi * frequency * k);
  return sum;
}

}  // namespace

NoiseModel noise_model(const Autocorrelations& a) {
  const Lags mean(a, a.mean), difference(a, a.difference);
  const int axial = a.lags - 7, lateral = a.laterals - 5;
  double sum_x = 0, sum_y = 0;
  for (int q = -lateral; q <= lateral; ++q)
    for (int k = -axial; k <= axial; ++k) {
      sum_y += mean.axial_gradient(k, q) * difference.at(k, q);
      sum_x += mean.lateral_gradient(k, q) * difference.at(k, q);
    }
  const double gy = mean.axial_gradient(0, 0), gx = mean.lateral_gradient(0, 0), dd = difference.at(0, 0);
  NoiseModel model;
  if (!(gy > 0 && gx > 0 && dd > 0)) return model;
  model.spread = {std::max(sum_x / (gx * dd), 0.2), std::max(sum_y / (gy * dd), 0.2)};
  model.sensitivity = {std::clamp(1 - 0.25 * difference.lateral_gradient(0, 0) / gx, 0.05, 1.0),
                       std::clamp(1 - 0.25 * difference.axial_gradient(0, 0) / gy, 0.05, 1.0)};
  return model;
}

std::vector<float> matched_filter(const Autocorrelations& a, int reach) {
  constexpr int kFrequencies = 128;
  std::vector<double> p(kFrequencies + 1), q(kFrequencies + 1);
  const auto frequency = [](int n) { return 0.5 * n / kFrequencies; };
  for (int n = 0; n <= kFrequencies; ++n) {
    p[static_cast<std::size_t>(n)] = spectrum(a, a.mean, frequency(n));
    q[static_cast<std::size_t>(n)] = spectrum(a, a.difference, frequency(n)) / 4;
  }
  const double least_p = kQuietest * *std::max_element(p.begin(), p.end());
  const double least_q = kQuietest * *std::max_element(q.begin(), q.end());
  std::vector<double> gain;
  for (int n = 0; n <= kFrequencies; ++n) {
    const double mean = std::max(p[static_cast<std::size_t>(n)], least_p),
                 noise = std::max(q[static_cast<std::size_t>(n)], least_q);
    const double pass = std::clamp((kStopEdge - frequency(n)) / (kStopEdge - kPassEdge), 0.0, 1.0);
    gain.push_back(pass * std::sqrt(std::max(1 / noise - 1 / mean, 0.0)));
  }
  const double peak = *std::max_element(gain.begin(), gain.end());
  std::vector<float> taps;
  for (int k = 0; k <= reach; ++k) {
    double sum = 0;
    for (int n = 0; n <= kFrequencies; ++n)
      sum += (n == 0 || n == kFrequencies ? 0.5 : 1.0) * gain[static_cast<std::size_t>(n)] *
             std::cos(2 * std::numbers::pi * frequency(n) * k);
    const double window = 0.5 + 0.5 * std::cos(std::numbers::pi * k / (reach + 1));
    taps.push_back(
        static_cast<float>(peak > 0 ? window * sum / (kFrequencies * peak) : (k == 0 ? 1.0 : 0.0)));
  }
  return taps;
}

}  // namespace teletact::service
