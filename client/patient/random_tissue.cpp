// Random patients: rejection sampling within the rules stated in tissue.h.
#include <algorithm>
#include <cmath>
#include <random>

#include "client/patient/tissue.h"

namespace teletact::client {

namespace {

constexpr double kWindow = 0.060, kDeepest = 0.025, kGap = 0.015, kCover = 0.002, kMargin = 0.012;
constexpr double kSmallest = 0.008, kLargest = 0.015, kMinContrast = 3, kMaxContrast = 10;

using Random = std::mt19937_64;

// Portable: the same seed gives the same patient with every standard library.
double uniform(Random& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
}

// The k-th of n equal parts of a range, shuffled by `order`: sizes and contrasts all differ.
double stratified(Random& random, const std::vector<std::size_t>& order, std::size_t k, double low,
                  double high) {
  const double part = (high - low) / static_cast<double>(order.size());
  return uniform(random, low + part * static_cast<double>(order[k]),
                 low + part * static_cast<double>(order[k] + 1));
}

std::vector<std::size_t> shuffled(Random& random, std::size_t n) {
  std::vector<std::size_t> order(n);
  for (std::size_t i = 0; i < n; ++i) order[i] = i;
  for (std::size_t i = n; i > 1; --i) std::swap(order[i - 1], order[random() % i]);
  return order;
}

bool apart(const Inclusion& a, const Inclusion& b) {
  return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m) >= (a.diameter_m + b.diameter_m) / 2 + kGap;
}

bool crosses_a_border(const Inclusion& i) {
  const double from_border = std::abs(i.x_m - kWindow * std::round(i.x_m / kWindow));
  return from_border < i.diameter_m / 2;
}

// Places them one after the other; empty when one finds no room (the caller draws again).
std::vector<Inclusion> placed(Random& random, std::size_t count, double width_m) {
  const auto sizes = shuffled(random, count), depths = shuffled(random, count),
             contrasts = shuffled(random, count);
  std::vector<Inclusion> out;
  for (std::size_t k = 0; k < count; ++k) {
    Inclusion next;
    next.diameter_m = stratified(random, sizes, k, kSmallest, kLargest);
    next.contrast = stratified(random, contrasts, k, kMinContrast, kMaxContrast);
    const double radius = next.diameter_m / 2;
    next.y_m = stratified(random, depths, k, radius + kCover, kDeepest - radius);
    bool found = false;
    for (int attempt = 0; attempt < 200 && !found; ++attempt) {
      if (k == 0) {  // the one across a border of two windows
        const double border = kWindow * static_cast<double>(1 + random() % 4);
        next.x_m = border + uniform(random, -.5, .5) * radius;
      } else {
        next.x_m = uniform(random, radius + kMargin, width_m - radius - kMargin);
        if (crosses_a_border(next)) continue;
      }
      found = std::all_of(out.begin(), out.end(), [&](const Inclusion& other) { return apart(next, other); });
    }
    if (!found) return {};
    out.push_back(next);
  }
  return out;
}

}  // namespace

Tissue random_tissue(std::uint64_t seed) {
  Random random(seed * 0x9E3779B97F4A7C15u + 1);
  Tissue tissue;
  tissue.seed = seed;
  const std::size_t count = 3 + random() % 3;
  while (tissue.inclusions.empty()) tissue.inclusions = placed(random, count, tissue.width_m);
  std::sort(tissue.inclusions.begin(), tissue.inclusions.end(),
            [](const Inclusion& a, const Inclusion& b) { return a.x_m < b.x_m; });
  return tissue;
}

Tissue random_solid_tissue(std::uint64_t seed) {
  constexpr std::size_t kLumps = 3;
  constexpr double kMinM = 0.008, kMaxM = 0.012, kContrast = 6, kBottomM = 0.020, kAsideM = 0.018,
                   kApartM = 0.006;
  Random random(seed * 0x9E3779B97F4A7C15u + 3);
  Tissue tissue;
  tissue.seed = seed;
  tissue.width_m = 0.120;
  tissue.probe.compression_m = 0.0008;
  tissue.ultrasound.elevation_beam_m = 0.0015;
  tissue.solid.emplace();
  tissue.solid->texture = 0.05;
  const auto sizes = shuffled(random, kLumps), depths = shuffled(random, kLumps),
             contrasts = shuffled(random, kLumps);
  const auto clear = [&](const Inclusion& next) {
    return std::all_of(tissue.inclusions.begin(), tissue.inclusions.end(), [&](const Inclusion& other) {
      return std::hypot(next.x_m - other.x_m, next.y_m - other.y_m, next.z_m - other.z_m) >=
             (next.diameter_m + other.diameter_m) / 2 + kApartM;
    });
  };
  for (std::size_t k = 0; k < kLumps; ++k) {
    Inclusion next;
    next.sphere = true;
    next.diameter_m = stratified(random, sizes, k, kMinM, kMaxM);
    next.contrast = stratified(random, contrasts, k, kMinContrast, kContrast);
    const double radius = next.diameter_m / 2;
    next.y_m = stratified(random, depths, k, radius + kCover, kBottomM - radius);
    do {
      next.x_m = tissue.width_m / 2 + uniform(random, -kAsideM, kAsideM);
      next.z_m = uniform(random, -kAsideM, kAsideM);
    } while (!clear(next));
    tissue.inclusions.push_back(next);
  }
  return tissue;
}

}  // namespace teletact::client
