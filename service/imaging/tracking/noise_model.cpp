#include "service/imaging/tracking/noise_model.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <numbers>

namespace teletact::service {

namespace {

using Axis = Eigen::Array<double, kWaves, 1>;  // at the wave numbers of one direction

Axis over_axis(auto&& f) {
  Axis values;
  for (int n = 0; n < kWaves; ++n) values[n] = f(std::numbers::pi * (n + 0.5) / kWaves);
  return values;
}

Waves product(const Axis& along, const Axis& down) {
  return along.matrix() * down.matrix().transpose();
}

// Share of the hat functions' power: neighbours overlap by sum hat hat' / sum hat.
Axis hat_share(int step) {
  double own = 0, next = 0;
  for (int n = -step; n <= step; ++n) {
    const double hat = 1 - std::abs(n) / static_cast<double>(step);
    own += hat * hat / step;
    if (n >= 0) next += hat * (1 - hat) / step;
  }
  return over_axis([=](double k) { return own + 2 * next * std::cos(k); });
}

// Mean over 2 radius + 1 nodes.
Axis box(int radius) {
  return over_axis([=](double k) {
    double sum = 1;
    for (int n = 1; n <= radius; ++n) sum += 2 * std::cos(n * k);
    return sum / (2 * radius + 1);
  });
}

// Over the directions of a kernel: of `half` nodes along or down, a mean across.
Waves over_kernel(auto&& of, int half_columns, int half_rows, bool along) {
  return along ? product(of(half_columns), box(half_rows)) : product(box(half_columns), of(half_rows));
}

// Of a least-squares plane, over i.
Waves slope(int half_columns, int half_rows, bool along) {
  const auto of = [](int half) {
    return over_axis([half](double k) {
      double moment = 0, squares = 0;
      for (int n = 1; n <= half; ++n) {
        moment += 2 * n * std::sin(n * k);
        squares += 2.0 * n * n;
      }
      return moment / squares;
    });
  };
  return over_kernel(of, half_columns, half_rows, along);
}

// What is left of it where its mean by a plane's weights is taken off.
Waves rest(int half_columns, int half_rows, bool along) {
  const auto of = [](int half) {
    return over_axis([half](double k) {
      double sum = 0, weights = 0;
      for (int n = -half; n <= half; ++n) {
        const double weight = half * (half + 1) - n * n;
        sum += weight * std::cos(n * k), weights += weight;
      }
      return sum / weights;
    });
  };
  return slope(half_columns, half_rows, along) * (1 - over_kernel(of, half_columns, half_rows, along));
}

Waves wave_number(bool along) {
  const Axis k = over_axis([](double wave) { return wave; });
  return along ? product(k, Axis::Ones()) : product(Axis::Ones(), k);
}

// Power of the displacement at a jump of strain.
Waves jump() {
  const Waves squared = wave_number(true).square() + wave_number(false).square();
  return 1 / (squared.square() * squared.sqrt());
}

// Root of a quotient, 0 of nothing seen.
float over_seen(double off, double seen) {
  return static_cast<float>(seen > 0 ? std::sqrt(off / seen) : 0);
}

}  // namespace

// Each step the pixels pull towards themselves and the edges towards the mean gradient.
NoiseResponse::NoiseResponse(const SmootherResponse& s, double median, int line_step, int sample_step)
    : median_(median), shares_(product(hat_share(line_step), hat_share(sample_step))) {
  const int r = s.gradient_radius;
  const Axis one = Axis::Ones(), apart = over_axis([](double k) { return 2 * (1 - std::cos(k)); }),
             pulled = over_axis([r](double k) { return std::sin(k) * std::sin(r * k) / r; });
  const Waves stiff = s.weight_along * product(apart, one) + s.weight_down * product(one, apart);
  edges_ = stiff - s.weight_along * product(pulled, box(r)) - s.weight_down * product(box(r), pulled);
  for (int entry = 0; entry < static_cast<int>(DeviationTable{}.size()); ++entry) {
    const double h = median * std::ldexp(1.0, entry - kBelowMedian);
    const Waves scale = 1 / (h + stiff);
    Waves t = Waves::Zero();
    for (int step = 0; step < s.steps; ++step)  // T(k) of T2.3c
      t += scale * (h * shares_ * (1 - t) - edges_ * t);
    entries_.push_back({h, t});
  }
}

DeviationTable NoiseResponse::over_entries(auto&& of) const {
  DeviationTable table;
  std::ranges::transform(entries_, table.begin(), of);
  return table;
}

DeviationTable NoiseResponse::table(const Waves& squared) const {
  const Waves gain = squared / shares_;
  return over_entries([&](const Entry& e) {
    return static_cast<float>(std::sqrt((gain * e.passed.square()).mean() / e.information));
  });
}

DeviationTable NoiseResponse::deviation() const {
  return table(Waves::Ones());
}

DeviationTable NoiseResponse::slope(int half_columns, int half_rows, bool along) const {
  return table(service::slope(half_columns, half_rows, along).square());
}

DeviationTable NoiseResponse::slope_rest(int half_columns, int half_rows, bool along) const {
  return table(rest(half_columns, half_rows, along).square());
}

DeviationTable NoiseResponse::bias_noise(int radius) const {
  const Waves gain = (edges_ * product(box(radius), box(radius))).square() / shares_;
  return over_entries([&](const Entry& e) {
    return static_cast<float>(std::sqrt((gain * e.passed.square()).mean() / e.information) / e.information);
  });
}

DeviationTable NoiseResponse::bias_over_seen(int radius) const {
  const Waves power = jump(), force = power * (edges_ * product(box(radius), box(radius))).square();
  return over_entries([&](const Entry& e) {
    return e.information *
           over_seen((power * (1 - e.passed).square()).sum(), (force * e.passed.square()).sum());
  });
}

DeviationTable NoiseResponse::slope_bias_over_seen(int half_columns, int half_rows, bool along) const {
  const Waves power = jump(), truth = wave_number(along),
              found = service::slope(half_columns, half_rows, along),
              seen = power * rest(half_columns, half_rows, along).square();
  return over_entries([&](const Entry& e) {
    return over_seen((power * (truth - found * e.passed).square()).sum(), (seen * e.passed.square()).sum());
  });
}

namespace {

// The gradients of data_term in refinement.cl.
constexpr double kAxial[] = {-1.0 / 60, 0.15, -0.75, 0, 0.75, -0.15, 1.0 / 60};
constexpr double kLateral[] = {1.0 / 12, -2.0 / 3, 0, 2.0 / 3, -1.0 / 12};

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

// At `frequencies` + 1 frequencies from 0 to half the sampling frequency, smoothed by a Blackman window over
// the lags.
std::vector<double> spectrum(std::vector<double> r, int frequencies) {
  for (std::size_t k = 1; k < r.size(); ++k) {
    const double angle = std::numbers::pi * static_cast<double>(k) / static_cast<double>(r.size());
    r[k] *= 2 * (0.42 + 0.5 * std::cos(angle) + 0.08 * std::cos(2 * angle));
  }
  std::vector<double> values;
  for (int n = 0; n <= frequencies; ++n) {
    double sum = 0;
    for (std::size_t k = 0; k < r.size(); ++k)
      sum += r[k] * std::cos(std::numbers::pi * n * static_cast<double>(k) / frequencies);
    values.push_back(sum);
  }
  return values;
}

struct Band {
  double pass, stop;  // of the sampling frequency
  double quietest;    // noise below this part of its peak is not believed
};

// Gain at the frequencies of spectrum().
std::vector<double> best_gain(const std::vector<double>& mean, const std::vector<double>& difference,
                              int frequencies, const Band& band) {
  const std::vector<double> p = spectrum(mean, frequencies);
  std::vector<double> q = spectrum(difference, frequencies), gain;
  for (double& power : q) power /= 4;
  const double min_q = band.quietest * *std::max_element(q.begin(), q.end());
  for (int n = 0; n <= frequencies; ++n) {
    const auto at = static_cast<std::size_t>(n);
    const double common = p[at] - q[at];
    const double signal = p[at] > 0 && common > 0 ? common / (p[at] * std::max(q[at], min_q)) : 0;
    const double pass = std::clamp((band.stop - 0.5 * n / frequencies) / (band.stop - band.pass), 0.0, 1.0);
    gain.push_back(pass * std::sqrt(signal));
  }
  return gain;
}

// Symmetric taps 0 .. reach of a gain, unit gain at its peak.
std::vector<float> taps_of(const std::vector<double>& gain, int reach) {
  const int frequencies = static_cast<int>(gain.size()) - 1;
  const double peak = *std::max_element(gain.begin(), gain.end());
  std::vector<float> taps;
  for (int k = 0; k <= reach; ++k) {
    double sum = 0;
    for (int n = 0; n <= frequencies; ++n)
      sum += (n == 0 || n == frequencies ? 0.5 : 1.0) * gain[static_cast<std::size_t>(n)] *
             std::cos(std::numbers::pi * n * k / frequencies);
    const double window = 0.5 + 0.5 * std::cos(std::numbers::pi * k / (reach + 1));
    taps.push_back(static_cast<float>(peak > 0 ? window * sum / (frequencies * peak) : (k == 0 ? 1.0 : 0.0)));
  }
  return taps;
}

constexpr Band kAxialBand{0.30, 0.36, 1e-2}, kLateralBand{0.38, 0.48, 0.3};  // within what interpolates well

// The lags of one direction, none in the other.
std::vector<double> lags_along(const Autocorrelations& a, const std::vector<double>& r, bool axial) {
  std::vector<double> out;
  for (int k = 0; k < (axial ? a.lags : a.laterals); ++k)
    out.push_back(r[static_cast<std::size_t>(axial ? k : k * a.lags)]);
  return out;
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
  // sum rho_gradient rho_difference over all lags (T2.3b)
  model.spread = {std::max(sum_x / (gx * dd), 0.2), std::max(sum_y / (gy * dd), 0.2)};
  model.sensitivity = {std::clamp(1 - 0.25 * difference.lateral_gradient(0, 0) / gx, 0.05, 1.0),
                       std::clamp(1 - 0.25 * difference.axial_gradient(0, 0) / gy, 0.05, 1.0)};
  return model;
}

MatchedFilter matched_filter(const Autocorrelations& a, int axial_reach, int lateral_reach) {
  constexpr int kFrequencies = 128;
  const std::vector<double> axial =
      best_gain(lags_along(a, a.mean, true), lags_along(a, a.difference, true), kFrequencies, kAxialBand);
  const std::vector<double> lateral =
      best_gain(lags_along(a, a.mean, false), lags_along(a, a.difference, false), kFrequencies, kLateralBand);
  return {taps_of(axial, axial_reach), taps_of(lateral, lateral_reach)};
}

}  // namespace teletact::service
