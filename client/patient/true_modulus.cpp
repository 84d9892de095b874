#include "client/patient/true_modulus.h"

#include <cmath>
#include <numbers>
#include <random>

namespace teletact::client {

namespace {

constexpr int kWaves = 200;  // a sum of so many is as good as Gaussian

double drawn(std::mt19937_64& random) {
  return (static_cast<double>(random() >> 11) + .5) * 0x1p-53;
}

}  // namespace

// Waves whose numbers are Gaussian of deviation 1 / length: their sum correlates by exp(-d^2 / 2 length^2).
TrueModulus::TrueModulus(const Tissue& tissue) : tissue_(tissue) {
  if (!tissue.solid || tissue.solid->texture == 0) return;
  std::mt19937_64 random(tissue.seed ^ 0x7E87008E00000000u);
  const auto gaussian = [&] {
    const double radius = std::sqrt(-2 * std::log(drawn(random)));
    return radius * std::cos(2 * std::numbers::pi * drawn(random)) / tissue.solid->texture_length_m;
  };
  for (int n = 0; n < kWaves; ++n) {
    Wave w{};
    w.x = gaussian(), w.y = gaussian(), w.z = gaussian();
    w.phase = 2 * std::numbers::pi * drawn(random);
    waves_.push_back(w);
  }
}

double TrueModulus::texture(double x_m, double y_m, double z_m) const {
  if (waves_.empty()) return 1;
  double sum = 0;
  for (const Wave& w : waves_) sum += std::cos(w.x * x_m + w.y * y_m + w.z * z_m + w.phase);
  return std::exp(tissue_.solid->texture * std::sqrt(2.0 / kWaves) * sum);
}

double TrueModulus::operator()(double x_m, double y_m, double z_m) const {
  return tissue_.true_modulus(x_m, y_m, z_m) * texture(x_m, y_m, z_m);
}

}  // namespace teletact::client
