// What is uncertain of the force, from the arm's sensor to the deviation that the service states.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "client/acquire/simulated_pair.h"
#include "client/patient/tissue.h"
#include "service/rpc/estimate_messages.h"

namespace teletact {
namespace {

// ln E is off by as much as ln of the force is, strain and area being right.
struct Sensed {
  double off, deviation;
};
Sensed sensed(const client::Probe& probe, double true_n, std::uint64_t seed) {
  client::ProbeState state;
  state.force_n = true_n, state.contact_area_m2 = probe.contact_area_m2();
  v1::Acquisition a;
  a.set_sample_count(2048), a.set_line_count(256), a.set_dtype(v1::DATA_TYPE_INT16);
  a.set_center_frequency_hz(7.3e6), a.set_sampling_frequency_hz(40e6), a.set_sound_speed_m_s(1540);
  a.set_line_pitch_m(probe.line_pitch_m()), a.set_displacement_frame(v1::DISPLACEMENT_FRAME_PROBE);
  *a.mutable_probe_force() = client::sensed(probe, state, seed);
  const service::Scenes none{""};
  const service::EstimateRequest request = service::request_from(a, none, service::Limits());
  return {std::log(request.force->force_n / true_n), request.force->deviation()};
}

// Tissue of 500 Pa bears 8.5 mN; the sensor's noise is 2 mN, its zero drifts by 3, its gain is 5 % off.
TEST(StatedErrors, HoldTheNoiseOfTheArmsSensor) {
  constexpr int kDraws = 200;
  client::Probe noisy, drifting;
  drifting.force_gain_error = 0.05, drifting.force_gain_std = 0.03, drifting.force_zero_std_n = 0.003;
  for (const auto& [probe, true_n] : {std::pair{noisy, 0.0085}, {noisy, 0.2}, {drifting, 0.2}}) {
    int held = 0;
    double squares = 0, stated = 0;
    for (int seed = 0; seed < kDraws; ++seed) {
      client::Probe now = probe;
      if (now.force_zero_std_n > 0) now.force_zero_n = seed % 2 ? 0.003 : -0.003;
      const Sensed s = sensed(now, true_n, static_cast<std::uint64_t>(seed));
      held += std::abs(s.off) <= 1.96 * s.deviation;
      squares += s.off * s.off / kDraws, stated += s.deviation / kDraws;
    }
    std::printf("%.4f N: off by %.3f rms, stated %.3f, %d of %d held\n", true_n, std::sqrt(squares), stated,
                held, kDraws);
    EXPECT_GE(held, 0.9 * kDraws) << true_n;
    EXPECT_LE(stated, 2 * std::sqrt(squares) + 0.05) << "5 % are the area's";
  }
}

}  // namespace
}  // namespace teletact
