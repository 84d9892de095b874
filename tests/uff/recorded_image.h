// What a beamformer would have written of simulated RF: IQ or the analytic signal, at fewer depths.
#pragma once

#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

namespace teletact::client {

struct ComplexLines {
  std::size_t samples = 0;  // of each line
  std::vector<float> real, imaginary;
};

// Of RF at `sampling_hz`, axial fastest: shifted down by `shift_hz`, through a low pass of `cutoff_hz` (a
// sinc under a Hann window, 2 x 64 samples), every `every`-th sample, shifted up again by `up_hz`. The first
// sample lies at the two-way time `first_s`.
inline ComplexLines demodulated(const std::vector<float>& rf, std::size_t samples, double sampling_hz,
                                double shift_hz, double cutoff_hz, std::size_t every, double first_s = 0,
                                double up_hz = 0) {
  constexpr std::ptrdiff_t kHalf = 64;
  constexpr double kPi = std::numbers::pi;
  std::vector<double> taps;
  for (std::ptrdiff_t k = -kHalf; k <= kHalf; ++k) {
    const double t = static_cast<double>(k), w = 2 * cutoff_hz / sampling_hz;
    taps.push_back((k == 0 ? w : std::sin(kPi * w * t) / (kPi * t)) * (1 + std::cos(kPi * t / kHalf)));
  }
  ComplexLines out;
  out.samples = (samples - 1) / every + 1;
  const std::size_t lines = rf.size() / samples;
  std::vector<std::complex<double>> down(samples);
  for (std::size_t l = 0; l < lines; ++l) {
    for (std::size_t k = 0; k < samples; ++k)
      down[k] = double{rf[k + samples * l]} *
                std::polar(1.0, -2 * kPi * shift_hz * (first_s + static_cast<double>(k) / sampling_hz));
    for (std::size_t s = 0; s < out.samples; ++s) {
      std::complex<double> sum{};
      const auto at = static_cast<std::ptrdiff_t>(s * every);
      for (std::ptrdiff_t k = -kHalf; k <= kHalf; ++k)
        if (at + k >= 0 && at + k < static_cast<std::ptrdiff_t>(samples))
          sum += down[static_cast<std::size_t>(at + k)] * taps[static_cast<std::size_t>(k + kHalf)];
      sum *= std::polar(1.0, 2 * kPi * up_hz * (first_s + static_cast<double>(at) / sampling_hz));
      out.real.push_back(static_cast<float>(sum.real()));
      out.imaginary.push_back(static_cast<float>(sum.imag()));
    }
  }
  return out;
}

}  // namespace teletact::client
