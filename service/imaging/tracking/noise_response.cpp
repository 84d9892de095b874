#include "service/imaging/tracking/noise_response.h"

#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <numbers>

namespace teletact::service {
namespace {

constexpr int kWaves = 32;  // per direction, midpoints of [0, pi]

double wave(int n) {
  return std::numbers::pi * (n + 0.5) / kWaves;
}

// Share of the hat functions' power at wave number k: neighbours overlap by sum hat hat' / sum hat.
double hat_share(int step, double k) {
  double own = 0, next = 0;
  for (int n = -step; n <= step; ++n) {
    const double hat = 1 - std::abs(n) / static_cast<double>(step);
    own += hat * hat / step;
    if (n >= 0) next += hat * (1 - hat) / step;
  }
  return own + 2 * next * std::cos(k);
}

// Mean over 2 radius + 1 nodes.
double box(int radius, double k) {
  double sum = 1;
  for (int n = 1; n <= radius; ++n) sum += 2 * std::cos(n * k);
  return sum / (2 * radius + 1);
}

template <class Function>
std::vector<double> over_waves(const Function& f) {
  std::vector<double> values;
  for (int j = 0; j < kWaves; ++j)
    for (int i = 0; i < kWaves; ++i) values.push_back(f(wave(i), wave(j)));
  return values;
}

}  // namespace

// Each step the pixels pull towards themselves and the edges towards the mean gradient.
NoiseResponse::NoiseResponse(const SmootherResponse& s, double median, int line_step, int sample_step)
    : median_(median) {
  const int r = s.gradient_radius;
  const std::vector<double> shares =
      over_waves([&](double a, double d) { return hat_share(line_step, a) * hat_share(sample_step, d); });
  const std::vector<double> stiff = over_waves([&](double a, double d) {
    return 2 * s.weight_along * (1 - std::cos(a)) + 2 * s.weight_down * (1 - std::cos(d));
  });
  const std::vector<double> pull = over_waves([&](double a, double d) {
    return s.weight_along * std::sin(a) * std::sin(r * a) / r * box(r, d) +
           s.weight_down * std::sin(d) * std::sin(r * d) / r * box(r, a);
  });
  for (int entry = 0; entry < static_cast<int>(DeviationTable{}.size()); ++entry) {
    const double h = median * std::ldexp(1.0, entry - kBelowMedian);
    for (std::size_t n = 0; n < shares.size(); ++n) {
      double t = 0;
      for (int step = 0; step < s.steps; ++step)  // T(k) of T2.3c
        t += (h * shares[n] * (1 - t) - (stiff[n] - pull[n]) * t) / (h + stiff[n]);
      power_.push_back(t * t / (h * shares[n]));
      lost_.push_back(1 - t);
      seen_.push_back(t * (stiff[n] - pull[n]) / h);
    }
  }
}

DeviationTable NoiseResponse::table(const Response& squared) const {
  const std::vector<double> gain =
      over_waves([&](double a, double d) { return squared(a, d) / (kWaves * kWaves); });
  DeviationTable table;
  for (std::size_t entry = 0; entry < table.size(); ++entry) {
    double variance = 0;
    for (std::size_t n = 0; n < gain.size(); ++n) variance += gain[n] * power_[entry * gain.size() + n];
    table[entry] = static_cast<float>(std::sqrt(variance));
  }
  return table;
}

DeviationTable NoiseResponse::bias_noise(int radius) const {
  DeviationTable table{};
  const std::vector<double> averaged =
      over_waves([=](double a, double d) { return box(radius, a) * box(radius, d); });
  for (std::size_t n = 0; n < seen_.size(); ++n) {
    // power_ holds |T|^2 / (h m); of the bias seen only the edges' part differs from it.
    const double edges = lost_[n] < 1 ? seen_[n] / (1 - lost_[n]) : 0;
    table[n / averaged.size()] +=
        static_cast<float>(power_[n] * std::pow(edges * averaged[n % averaged.size()], 2) /
                           static_cast<double>(averaged.size()));
  }
  for (float& d : table) d = std::sqrt(d);
  return table;
}

DeviationTable NoiseResponse::bias_over_seen(int radius) const {
  DeviationTable table{};
  const std::vector<double> averaged =
      over_waves([=](double a, double d) { return box(radius, a) * box(radius, d); });
  const std::vector<double> jump =
      over_waves([](double a, double d) { return std::pow(std::hypot(a, d), -5); });
  for (std::size_t entry = 0; entry * averaged.size() < seen_.size(); ++entry) {
    double lost = 0, seen = 0;
    for (std::size_t n = 0; n < averaged.size(); ++n) {
      const std::size_t at = entry * averaged.size() + n;
      lost += jump[n] * lost_[at] * lost_[at];
      seen += jump[n] * std::pow(seen_[at] * averaged[n], 2);
    }
    table[entry] = static_cast<float>(seen > 0 ? std::sqrt(lost / seen) : 0);
  }
  return table;
}

Response plane_slope(int half_columns, int half_rows, bool along) {
  return [=](double a, double d) {
    const int half = along ? half_columns : half_rows;
    const double k = along ? a : d, other = along ? box(half_rows, d) : box(half_columns, a);
    double moment = 0, squares = 0;
    for (int n = 1; n <= half; ++n) {
      moment += 2 * n * std::sin(n * k);
      squares += 2.0 * n * n;
    }
    return std::pow(moment / squares * other, 2);
  };
}

}  // namespace teletact::service
