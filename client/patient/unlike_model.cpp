// Solids that are unlike what an estimator assumes in every way at once: all that can be stated of a solid,
// its probe, beam and sensor is drawn, within what real ones are.
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "client/patient/tissue.h"

namespace teletact::client {

namespace {

// Portable: the same seed gives the same tissue with every standard library.
class Drawn {
 public:
  explicit Drawn(std::uint64_t seed) : random_(seed * 0x9E3779B97F4A7C15u + 0x17) {}
  double between(double low, double high) { return low + (high - low) * unit(); }
  bool one_in(int of) { return unit() * of < 1; }
  double gaussian(double deviation) {
    const double radius = std::sqrt(-2 * std::log(1 - unit()));
    return deviation * radius * std::cos(2 * std::numbers::pi * unit());
  }

 private:
  double unit() { return static_cast<double>(random_() >> 11) * 0x1p-53; }
  std::mt19937_64 random_;
};

constexpr double kImagedM = 0.040, kLumpM = 0.010;
constexpr double kGainDeviation = 0.03, kZeroDeviationN = 0.003;

void draw_solid(Drawn& d, Tissue& t) {
  Solid& s = t.solid.emplace();
  t.depth_m = d.one_in(2) ? kImagedM : d.between(kImagedM, .060);
  t.ultrasound.depth_m = kImagedM;
  t.width_m = d.between(.100, .160);
  s.elevational_width_m = d.between(.060, .120);
  if (d.one_in(4)) t.width_m = t.probe.width_m, s.elevational_width_m = t.probe.elevation_m;
  if (d.one_in(3))
    s.support = Support::kSliding;
  else if (d.one_in(2)) {
    s.support = Support::kBed;
    s.bed_depth_m = d.between(.005, .015), s.bed_modulus_pa = d.between(2e3, 8e3);
  }
  if (d.one_in(3))
    s.friction = d.between(.1, .6);
  else if (d.one_in(2))
    s.friction = std::numeric_limits<double>::infinity();
  s.uneven = d.between(-.1, .1);
  s.preload_m = d.between(.0015, .003);
  if (d.one_in(8)) s.lean_m = (d.one_in(2) ? 1 : -1) * d.between(1, 1.5) * s.preload_m;
  if (d.one_in(2)) s.capsule_m = d.between(.001, .002), s.capsule_contrast = d.between(2, 4);
  s.texture = d.between(.05, .20);
  s.texture_length_m = d.between(.003, .006);
}

void draw_machine(Drawn& d, Tissue& t) {
  t.ultrasound.elevation_beam_m = d.between(.001, .003);
  t.ultrasound.focus_m = d.between(.015, .025);
  t.ultrasound.beam_growth = d.between(.3, 1);
  t.ultrasound.attenuation_db_cm_mhz = d.between(.3, .7);
  t.probe.force_gain_error = d.gaussian(kGainDeviation);
  t.probe.force_zero_n = d.gaussian(kZeroDeviationN);
  t.probe.force_gain_std = kGainDeviation, t.probe.force_zero_std_n = kZeroDeviationN;
}

}  // namespace

Tissue unlike_model(std::uint64_t seed, double contrast) {
  Drawn d(seed);
  Tissue t;
  t.seed = seed;
  t.poisson_ratio = d.between(.485, .495);
  t.probe.compression_m = d.between(.0005, .0009);
  draw_solid(d, t);
  draw_machine(d, t);
  const bool sphere = d.one_in(2);
  const double x = t.width_m / 2 + d.between(-.015, .015), y = d.between(.012, .018);
  const double across = d.between(-.002, .002), drawn_contrast = d.between(2, 6);
  t.inclusions = {{x, y, kLumpM, contrast > 0 ? contrast : drawn_contrast, sphere,
                   sphere && std::abs(across) < t.solid->elevational_width_m / 2 ? across : 0}};
  return t;
}

}  // namespace teletact::client
