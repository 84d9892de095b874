// Echoes of 7 MHz, sampled at 40 MHz, of fully developed speckle: line after line, depth fastest.
#pragma once

#include <cmath>
#include <complex>
#include <cstddef>
#include <numbers>
#include <random>
#include <vector>

namespace teletact::client {

inline constexpr double kEchoHz = 7e6, kEchoSamplingHz = 40e6;

using Baseband = std::vector<std::complex<double>>;

// Without their carrier: noise under a Gaussian of half a microsecond.
inline Baseband baseband(std::size_t samples, std::size_t lines) {
  constexpr int kHalf = 24;
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  Baseband out(samples * lines), white(samples + 2 * kHalf);
  for (std::size_t l = 0; l < lines; ++l) {
    for (auto& w : white) w = {normal(random), normal(random)};
    for (std::size_t k = 0; k < samples; ++k)
      for (int t = -kHalf; t <= kHalf; ++t)
        out[k + samples * l] += white[k + static_cast<std::size_t>(t + kHalf)] * std::exp(-t * t / 50.0);
  }
  return out;
}

// Each sample by `value` of what it is without its carrier.
template <class Value>
std::vector<float> made_of(const Baseband& all, Value value) {
  std::vector<float> out;
  for (const auto& v : all) out.push_back(static_cast<float>(value(v)));
  return out;
}

inline std::vector<float> rf_of(const Baseband& all, std::size_t samples, double offset = 0) {
  std::size_t k = 0;
  return made_of(all, [&](std::complex<double> value) {
    const double turns = kEchoHz / kEchoSamplingHz * static_cast<double>(k++ % samples);
    return 100 * (value * std::polar(1.0, 2 * std::numbers::pi * turns)).real() + offset;
  });
}

inline std::vector<float> envelope_of(const Baseband& all) {
  return made_of(all, [](std::complex<double> value) { return 100 * std::abs(value); });
}

}  // namespace teletact::client
