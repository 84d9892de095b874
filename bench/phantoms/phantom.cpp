#include "bench/phantoms/phantom.h"

#include <cmath>
#include <utility>

namespace teletact::bench {
namespace {

constexpr double kWindowM = 0.060, kDepthM = 0.040, kInclusionDepthM = 0.015;
constexpr double kStrainStepM = 0.05e-3;  // of the central difference that gives the true strain

client::Tissue tissue_of(const PhantomCase& c) {
  client::Tissue t;
  t.width_m = c.tissue_width_m;
  t.depth_m = kDepthM;
  t.probe.width_m = kWindowM;
  if (c.contrast != 1) t.inclusions = {{t.width_m / 2, kInclusionDepthM, c.diameter_m, c.contrast}};
  return t;
}

service::RfFrame frame_of(const client::RfGeometry& g, const std::vector<std::int16_t>& samples) {
  return {g.sample_count, g.line_count, {samples.begin(), samples.end()}};
}

Phantom phantom_of(const client::Tissue& t, const client::ProbeState& probe, client::RfBase base,
                   double snr_db, double correlation, std::uint64_t seed) {
  base.ultrasound.snr_db = snr_db;
  base.ultrasound.correlation = correlation;
  const client::RfPair pair = client::with_noise(base, seed * 7919 + 17);
  Phantom p;
  p.pre = frame_of(pair.geometry, pair.pre);
  p.post = frame_of(pair.geometry, pair.post);
  p.geometry.center_frequency_hz = t.ultrasound.center_frequency_hz;
  p.geometry.sampling_frequency_hz = t.ultrasound.sampling_frequency_hz;
  p.geometry.sound_speed_m_s = t.ultrasound.sound_speed_m_s;
  p.geometry.line_pitch_m = pair.geometry.line_pitch_m;
  p.tissue = {t.width_m, t.depth_m, probe.window_x_m, t.poisson_ratio};
  p.force_n = probe.force_n;
  p.sensed_force_n = client::sensed_force(t.probe, probe.force_n, seed);
  p.contact_area_m2 = probe.contact_area_m2;
  p.field = probe.field;
  p.rest_m = probe.compression_m;
  return p;
}

// Linear in both coordinates: exact on one element.
Phantom linear(const Vector& shift_m, double axial, double lateral, double snr_db, double correlation,
               std::uint64_t seed) {
  PhantomCase c;
  c.contrast = 1;
  const client::Tissue t = tissue_of(c);
  client::PatientMesh mesh;
  mesh.x_m = {0, t.width_m};
  mesh.y_m = {0, t.depth_m};
  const double side = lateral * t.width_m / 2, below = shift_m.y + axial * t.depth_m;
  client::ProbeState probe;
  probe.width_m = kWindowM;
  probe.field = std::make_shared<client::PlaneField>(
      mesh, std::vector<double>{shift_m.x - side, shift_m.y, shift_m.x - side, below, shift_m.x + side,
                                shift_m.y, shift_m.x + side, below});
  return phantom_of(t, probe, client::simulate_rf(t, probe, client::RfFrame::kProbe, seed), snr_db,
                    correlation, seed);
}

}  // namespace

Vector Phantom::displacement_m(double x_m, double y_m) const {
  const auto u = field->at(tissue.window_x_m + x_m, y_m);
  return {u.x, u.y - rest_m};
}

double Phantom::axial_strain(double x_m, double y_m) const {
  return (displacement_m(x_m, y_m + kStrainStepM).y - displacement_m(x_m, y_m - kStrainStepM).y) /
         (2 * kStrainStepM);
}

double Phantom::radii(double x_m, double y_m) const {
  return 2 * std::hypot(x_m - inclusion_x_m, y_m - inclusion_y_m) / diameter_m;
}

const client::Patient& Phantoms::patient(const PhantomCase& c) {
  auto& kept = patients_[{c.contrast, c.diameter_m, c.tissue_width_m}];
  if (!kept) kept = std::make_unique<client::Patient>(tissue_of(c));
  return *kept;
}

Phantom Phantoms::make(const PhantomCase& c, std::uint64_t seed) {
  if (seed != base_seed_) bases_.clear();
  base_seed_ = seed;
  const client::Patient& whole = patient(c);
  const auto key = std::pair(TissueKey{c.contrast, c.diameter_m, c.tissue_width_m}, c.strain);
  auto found = bases_.find(key);
  if (found == bases_.end()) {
    client::ProbeState probe = whole.press((c.tissue_width_m - kWindowM) / 2, c.strain * kDepthM);
    client::RfBase base = client::simulate_rf(whole.tissue(), probe, client::RfFrame::kProbe, seed);
    found = bases_.emplace(key, std::pair(std::move(probe), std::move(base))).first;
  }
  const auto& [probe, base] = found->second;
  Phantom p = phantom_of(whole.tissue(), probe, base, c.snr_db, c.correlation, seed);
  p.inclusion_x_m = kWindowM / 2;
  p.inclusion_y_m = kInclusionDepthM;
  p.diameter_m = c.diameter_m;
  p.contrast = c.contrast;
  return p;
}

Phantom Phantoms::rigid(const Vector& shift_m, double snr_db, double correlation, std::uint64_t seed) {
  return linear(shift_m, 0, 0, snr_db, correlation, seed);
}

Phantom Phantoms::uniform(double axial_strain, double lateral_strain, double snr_db, double correlation,
                          std::uint64_t seed) {
  return linear({}, axial_strain, lateral_strain, snr_db, correlation, seed);
}

}  // namespace teletact::bench
