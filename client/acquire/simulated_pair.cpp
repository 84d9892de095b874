#include "client/acquire/simulated_pair.h"

#include <cstdint>

#include "client/patient/rf.h"

namespace teletact::client {
namespace {

v1::Acquisition acquisition_of(const RfBase& base, const ProbeState& state, double sensed_force_n) {
  v1::Acquisition out;
  out.set_sample_count(static_cast<std::uint32_t>(base.geometry.sample_count));
  out.set_line_count(static_cast<std::uint32_t>(base.geometry.line_count));
  out.set_dtype(v1::DATA_TYPE_INT16);
  out.set_center_frequency_hz(base.ultrasound.center_frequency_hz);
  out.set_sampling_frequency_hz(base.ultrasound.sampling_frequency_hz);
  out.set_sound_speed_m_s(base.ultrasound.sound_speed_m_s);
  out.set_line_pitch_m(base.geometry.line_pitch_m);
  out.set_displacement_frame(v1::DISPLACEMENT_FRAME_PROBE);  // the scanner sits on the probe
  out.mutable_probe_force()->set_force_n(sensed_force_n);
  out.mutable_probe_force()->set_contact_area_m2(state.contact_area_m2);
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
    out.push_back({acquisition_of(base, state, sensed_force(tissue.probe, state.force_n, mixed(seed))),
                   bytes_of(frames.pre), bytes_of(frames.post)});
  }
  return out;
}

}  // namespace teletact::client
