#include "client/patient/solid_patient.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace teletact::client {
namespace {

// From 0 to 1 across a border that `at_m` is beyond.
double across(double at_m) {
  return std::clamp(at_m / SolidPatient::kBorderM + 0.5, 0.0, 1.0);
}

}  // namespace

double SolidPatient::layered_pa(double y_m) const {
  double ln = std::log(layers_pa[0]);
  for (std::size_t n = 0; n < borders_m.size(); ++n)
    ln += across(y_m - borders_m[n]) * std::log(layers_pa[n + 1] / layers_pa[n]);
  return std::exp(ln);
}

double SolidPatient::modulus_pa(double x_m, double y_m, double z_m) const {
  double e = layered_pa(y_m);
  for (const Lump& l : lumps)
    e *= std::pow(l.contrast, across(l.radius_m - std::hypot(x_m - l.x_m, y_m - l.y_m, z_m - l.z_m)));
  return e;
}

SolidPatient random_solid_patient(std::uint64_t seed) {
  std::mt19937_64 random(seed * 0x9E3779B97F4A7C15u + 2);
  const auto uniform = [&](double low, double high) {  // the same with every standard library
    return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  SolidPatient patient;
  patient.layers_pa = {uniform(9e3, 13e3), uniform(6e3, 9e3), uniform(12e3, 18e3)};
  patient.borders_m = {uniform(0.003, 0.005), uniform(0.018, 0.024)};
  double side = random() % 2 == 0 ? 1 : -1;
  for (std::size_t n = 0; n < patient.lumps.size(); ++n, side = -side) {
    Lump& l = patient.lumps[n];
    l.radius_m = uniform(0.0045, 0.0065);
    l.contrast = uniform(3, 6);
    l.x_m = (n == 0 ? 0.030 : 0.070) + uniform(0, 0.012);
    l.y_m = l.radius_m + uniform(0.002, 0.006);
    l.z_m = side * uniform(0.003, 0.009);
  }
  return patient;
}

MetaImage modulus_volume(const SolidPatient& patient, const std::array<double, 3>& spacing_m) {
  const std::array<double, 3> size_m{SolidPatient::kWidthM, SolidPatient::kDepthM, 2 * SolidPatient::kEndM};
  std::vector<std::size_t> size;
  for (std::size_t a = 0; a < 3; ++a)
    size.push_back(static_cast<std::size_t>(std::lround(size_m[a] / spacing_m[a])));
  const std::vector<double> origin{spacing_m[0] / 2, spacing_m[1] / 2,
                                   spacing_m[2] / 2 - SolidPatient::kEndM};
  const auto at = [&](std::size_t axis, std::size_t n) {
    return origin[axis] + spacing_m[axis] * static_cast<double>(n);
  };
  std::vector<float> pa;
  for (std::size_t k = 0; k < size[2]; ++k)
    for (std::size_t j = 0; j < size[1]; ++j)
      for (std::size_t i = 0; i < size[0]; ++i)
        pa.push_back(static_cast<float>(patient.modulus_pa(at(0, i), at(1, j), at(2, k))));
  return MetaImage::of<float>(size, {spacing_m.begin(), spacing_m.end()}, origin, pa);
}

}  // namespace teletact::client
