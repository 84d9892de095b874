#include "client/acquire/simulated_pair.h"

#include <cmath>
#include <cstdint>

#include "client/patient/rf.h"

namespace teletact::client {

v1::ProbeForce sensed(const Probe& probe, const ProbeState& state, std::uint64_t seed) {
  v1::ProbeForce out;
  out.set_force_n(sensed_force(probe, state.force_n, seed));
  out.set_contact_area_m2(state.contact_area_m2);
  out.set_force_std_n(std::hypot(probe.force_noise_relative * out.force_n(), probe.force_noise_n));
  out.set_force_zero_std_n(probe.force_zero_std_n);
  out.set_force_gain_std(probe.force_gain_std);
  return out;
}

namespace {

v1::Acquisition acquisition_of(const RfBase& base, const v1::ProbeForce& force) {
  v1::Acquisition out;
  out.set_sample_count(static_cast<std::uint32_t>(base.geometry.sample_count));
  out.set_line_count(static_cast<std::uint32_t>(base.geometry.line_count));
  out.set_dtype(v1::DATA_TYPE_INT16);
  out.set_center_frequency_hz(base.ultrasound.center_frequency_hz);
  out.set_sampling_frequency_hz(base.ultrasound.sampling_frequency_hz);
  out.set_sound_speed_m_s(base.ultrasound.sound_speed_m_s);
  out.set_line_pitch_m(base.geometry.line_pitch_m);
  out.set_displacement_frame(v1::DISPLACEMENT_FRAME_PROBE);  // the scanner sits on the probe
  *out.mutable_probe_force() = force;
  out.add_maps("valid");  // the maps stay with the service; only the summary is needed here
  return out;
}

// SplitMix64: neighbouring inputs give unrelated outputs.
std::uint64_t mixed(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

}  // namespace

std::vector<FramePair> simulated_pairs(const Tissue& tissue, const ProbeState& state, std::size_t window,
                                       std::size_t passes) {
  const RfBase base = simulate_rf(tissue, state, RfFrame::kProbe, mixed(tissue.seed) + window);
  std::vector<FramePair> out;
  for (std::size_t pass = 0; pass < passes; ++pass) {
    const std::uint64_t seed = mixed(mixed(mixed(tissue.seed) + window) + pass);
    const RfPair frames = with_noise(base, seed);
    out.push_back({acquisition_of(base, sensed(tissue.probe, state, mixed(seed))), bytes_of(frames.pre),
                   bytes_of(frames.post)});
  }
  return out;
}

}  // namespace teletact::client
