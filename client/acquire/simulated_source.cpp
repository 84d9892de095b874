#include "client/acquire/simulated_source.h"

#include <algorithm>
#include <mutex>
#include <stdexcept>

#include "client/patient/parallel.h"
#include "client/patient/rf.h"

namespace teletact::client {
namespace {

// SplitMix64: neighbouring inputs give unrelated outputs.
std::uint64_t mix(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

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

}  // namespace

std::uint64_t pass_seed(std::uint64_t patient_seed, std::size_t window, std::size_t pass) {
  return mix(mix(mix(patient_seed) + window) + pass);
}

SimulatedSource::SimulatedSource(const Patient& patient, std::size_t passes, unsigned threads,
                                 const Progress& progress)
    : probe_(patient.tissue().probe),
      windows_(static_cast<std::size_t>(patient.tissue().width_m / patient.tissue().probe.width_m + 1e-6)) {
  if (windows_.empty()) throw std::invalid_argument("the tissue is narrower than the probe");
  if (passes == 0) throw std::invalid_argument("at least one pass must be prepared");
  std::mutex mutex;  // guards `done`
  std::size_t done = 0;
  in_parallel(
      windows_.size(),
      [&](std::size_t k) {
        simulate(patient, k, passes);
        const std::lock_guard lock(mutex);
        ++done;
        if (progress) progress(done, windows_.size());
      },
      threads);
}

void SimulatedSource::simulate(const Patient& patient, std::size_t window, std::size_t passes) {
  const ProbeState state = patient.press(window * probe_.width_m, probe_.compression_m);
  const RfBase base =
      simulate_rf(patient.tissue(), state, RfFrame::kProbe, mix(patient.tissue().seed) + window);
  windows_[window].passes.reserve(passes);
  for (std::size_t pass = 0; pass < passes; ++pass) {
    const std::uint64_t seed = pass_seed(patient.tissue().seed, window, pass);
    const RfPair frames = with_noise(base, seed);
    windows_[window].passes.push_back(
        {acquisition_of(base, state, sensed_force(probe_, state.force_n, mix(seed))), bytes_of(frames.pre),
         bytes_of(frames.post)});
  }
}

std::size_t SimulatedSource::frames_left(std::size_t window) const {
  const Window& w = windows_.at(window);
  return w.passes.size() - w.taken;
}

FramePair SimulatedSource::take(std::size_t window) {
  Window& w = windows_.at(window);
  if (w.taken == w.passes.size()) throw std::out_of_range("every prepared pass of this window is used up");
  return std::move(w.passes[w.taken++]);
}

}  // namespace teletact::client
