#include "client/patient/tissue.h"

#include <cmath>
#include <numbers>

namespace teletact::client {

namespace {

void require(bool ok, const std::string& key, const std::string& rule, double value) {
  if (ok) return;
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  throw TissueError(key + " = " + text + ": must be " + rule);
}

void in_range(const std::string& key, double value, double low, double high) {
  char rule[80];
  std::snprintf(rule, sizeof rule, "from %.4g to %.4g", low, high);
  require(value >= low && value <= high, key, rule, value);
}

void validate_inclusion(const Tissue& t, const Inclusion& inclusion, std::size_t index) {
  const std::string key = "inclusion[" + std::to_string(index) + "].";
  in_range(key + "diameter_m", inclusion.diameter_m, 5e-4, 1);
  in_range(key + "contrast", inclusion.contrast, .01, 1000);
  in_range(key + "position_m[0]", inclusion.x_m, 0, t.width_m);
  in_range(key + "position_m[1]", inclusion.y_m, 0, t.depth_m);
  require(t.solid || !inclusion.sphere, key + "shape", "cylinder where there is no [solid]", 0);
  const double side_m = t.solid ? t.solid->elevational_width_m / 2 : 0;
  in_range(key + "position_m[2]", inclusion.z_m, -side_m, side_m);
}

void validate_solid(const Tissue& t) {
  const Solid& s = *t.solid;
  in_range("solid.elevational_width_m", s.elevational_width_m, t.probe.elevation_m, 2);
  in_range("solid.bed_depth_m", s.bed_depth_m, 1e-3, .3);
  in_range("solid.bed_modulus_pa", s.bed_modulus_pa, 1, 1e9);
  require(s.friction >= 0, "solid.friction", "0 or more", s.friction);
  in_range("solid.uneven", s.uneven, -.5, .5);
  in_range("solid.preload_m", s.preload_m, 1e-5, .1);
  in_range("solid.lean_m", s.lean_m, -2 * s.preload_m, 2 * s.preload_m);
  in_range("solid.capsule_m", s.capsule_m, 0, t.depth_m);
  in_range("solid.capsule_contrast", s.capsule_contrast, .01, 1000);
  in_range("solid.bottom_contrast", s.bottom_contrast, .01, 100);
  in_range("solid.texture", s.texture, 0, 1);
  in_range("solid.texture_length_m", s.texture_length_m, 1e-3, 1);
}

void validate_probe(const Tissue& t) {
  const Probe& p = t.probe;
  in_range("probe.width_m", p.width_m, 2e-3, t.width_m);
  in_range("probe.lines", static_cast<double>(p.lines), 8, 2048);
  in_range("probe.elevation_m", p.elevation_m, 1e-4, 1);
  require(p.compression_m > 0 && p.compression_m <= .1 * t.depth_m, "probe.compression_m",
          "more than 0 and at most a tenth of tissue.depth_m (linear elasticity)", p.compression_m);
  in_range("probe.force_noise_relative", p.force_noise_relative, 0, .5);
  in_range("probe.force_noise_n", p.force_noise_n, 0, 10);
  in_range("probe.force_gain_error", p.force_gain_error, -.5, .5);
  in_range("probe.force_zero_n", p.force_zero_n, -10, 10);
  in_range("probe.force_gain_std", p.force_gain_std, 0, .5);
  in_range("probe.force_zero_std_n", p.force_zero_std_n, 0, 10);
}

void validate_ultrasound(const Tissue& t) {
  const Ultrasound& u = t.ultrasound;
  in_range("ultrasound.center_frequency_hz", u.center_frequency_hz, 1e5, 1e8);
  in_range("ultrasound.bandwidth", u.bandwidth, .05, 1.5);
  require(std::isfinite(u.sampling_frequency_hz) && u.sampling_frequency_hz <= 1e9 &&
              u.sampling_frequency_hz >= 2 * u.center_frequency_hz * (1 + u.bandwidth),
          "ultrasound.sampling_frequency_hz", "at least 2 center_frequency_hz (1 + bandwidth), at most 1e9",
          u.sampling_frequency_hz);
  in_range("ultrasound.sound_speed_m_s", u.sound_speed_m_s, 1000, 2500);
  in_range("ultrasound.f_number", u.f_number, .5, 10);
  in_range("ultrasound.snr_db", u.snr_db, -20, 200);
  in_range("ultrasound.correlation", u.correlation, 0, 1);
  in_range("ultrasound.depth_m", u.depth_m, 0, t.depth_m);
  require(u.depth_m == 0 || u.depth_m >= 2e-3, "ultrasound.depth_m", "0, or at least 0.002", u.depth_m);
  in_range("ultrasound.elevation_beam_m", u.elevation_beam_m, 0, .02);
  in_range("ultrasound.focus_m", u.focus_m, 1e-3, 1);
  in_range("ultrasound.beam_growth", u.beam_growth, 0, 3);
  in_range("ultrasound.attenuation_db_cm_mhz", u.attenuation_db_cm_mhz, 0, 2);
  require(centre_frequency_hz(u, t.imaged_depth_m()) >= .3 * u.center_frequency_hz,
          "ultrasound.attenuation_db_cm_mhz",
          "so little that 0.3 of the centre frequency is left at the bottom", u.attenuation_db_cm_mhz);
}

}  // namespace

double Tissue::true_modulus(double x_m, double y_m, double z_m) const {
  const double background =
      solid ? youngs_modulus_pa * std::pow(solid->bottom_contrast, y_m / depth_m) : youngs_modulus_pa;
  double modulus = background;
  if (solid && y_m < solid->capsule_m) modulus *= solid->capsule_contrast;
  for (const Inclusion& i : inclusions) {
    const double across = i.sphere ? z_m - i.z_m : 0;
    if (std::hypot(x_m - i.x_m, y_m - i.y_m, across) <= i.diameter_m / 2) modulus = background * i.contrast;
  }
  return modulus;
}

// |spectrum| falls to one half (-6 dB) at f0 (1 -+ B/2): B f0 / 2.355.
double spectrum_sigma_hz(const Ultrasound& u) {
  return u.bandwidth * u.center_frequency_hz / (2 * std::sqrt(2 * std::numbers::ln2));
}

double attenuation_per_m_hz(const Ultrasound& u) {
  constexpr double kDecibelsPerNeper = 8.685889638;
  return 2 * u.attenuation_db_cm_mhz * 100 / 1e6 / kDecibelsPerNeper;
}

double centre_frequency_hz(const Ultrasound& u, double depth_m) {
  return u.center_frequency_hz - std::pow(spectrum_sigma_hz(u), 2) * attenuation_per_m_hz(u) * depth_m;
}

const char* name_of(Support support) {
  switch (support) {
    case Support::kBonded:
      return "bonded";
    case Support::kSliding:
      return "sliding";
    case Support::kBed:
      return "bed";
  }
  return "";
}

void validate(const Tissue& t) {
  in_range("tissue.width_m", t.width_m, 5e-3, 2);
  in_range("tissue.depth_m", t.depth_m, 2e-3, .3);
  in_range("tissue.youngs_modulus_pa", t.youngs_modulus_pa, 1, 1e9);
  require(t.poisson_ratio >= 0 && t.poisson_ratio <= .4999, "tissue.poisson_ratio", "from 0 to 0.4999",
          t.poisson_ratio);
  in_range("tissue.thickness_m", t.thickness_m, 1e-4, 1);
  for (std::size_t i = 0; i < t.inclusions.size(); ++i) validate_inclusion(t, t.inclusions[i], i);
  validate_probe(t);
  validate_ultrasound(t);
  if (t.solid) validate_solid(t);
}

}  // namespace teletact::client
