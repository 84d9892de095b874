// Rows of `warnings` whose windows are frames: whether they are what is stated of them.
#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <random>
#include <utility>

#include "bench/suites/warnings/cases.h"
#include "client/patient/rf.h"

namespace teletact::bench {
namespace {

using service::RfFrame;
using service::WarningFlag;

constexpr double kFrameM = 0.020, kSqueezeM = 0.1e-3;  // of the tissue, square; strain 0.5 %

double drawn(std::uint64_t seed, double low, double high) {
  std::mt19937_64 random(seed);
  return std::uniform_real_distribution<double>(low, high)(random);
}

StatedFrames taken(std::uint64_t seed) {
  client::Tissue t;
  t.width_m = t.probe.width_m = kFrameM, t.probe.lines = 85, t.depth_m = kFrameM;
  t.ultrasound.snr_db = drawn(seed, 5, 30);
  // The same tissue for all: what differs is its speckle.
  static const client::ProbeState probe = client::Patient(t, 0.002).press(0, kSqueezeM);
  const client::RfPair pair =
      client::with_noise(client::simulate_rf(t, probe, client::RfFrame::kProbe, seed), seed);
  StatedFrames out;
  out.geometry = {t.ultrasound.center_frequency_hz, t.ultrasound.sampling_frequency_hz,
                  t.ultrasound.sound_speed_m_s, pair.geometry.line_pitch_m};
  const auto frame_of = [&](const std::vector<std::int16_t>& samples) {
    return RfFrame{pair.geometry.sample_count, pair.geometry.line_count, {samples.begin(), samples.end()}};
  };
  out.pre = frame_of(pair.pre), out.post = frame_of(pair.post);
  return out;
}

// Rectified, and the mean over about a period.
void detect(RfFrame& frame) {
  constexpr std::size_t kPeriod = 6;
  const std::vector<float> rf = frame.samples;
  for (std::size_t n = kPeriod; n < rf.size(); ++n) {
    frame.samples[n] = 0;
    for (std::size_t k = 0; k < kPeriod; ++k) frame.samples[n] += std::abs(rf[n - k]);
  }
}

void turn(RfFrame& frame) {
  const std::vector<float> rf = frame.samples;
  for (std::size_t n = 0; n < rf.size(); ++n)
    frame.samples[n / frame.sample_count + frame.line_count * (n % frame.sample_count)] = rf[n];
  std::swap(frame.sample_count, frame.line_count);
}

// A line of echoes, `loud` times the speckle, as a surface or a skin makes it.
void draw_line(RfFrame& frame, const service::AcquisitionGeometry& geometry, double depth_m, double loud) {
  constexpr double kThickM = 0.2e-3;  // standard deviation
  double power = 0;
  for (const float v : frame.samples) power += v * v / static_cast<double>(frame.samples.size());
  for (std::size_t k = 0; k < frame.sample_count; ++k) {
    const double from_m = geometry.sample_pitch_m() * static_cast<double>(k) - depth_m;
    const double wave = std::cos(4 * M_PI * geometry.center_frequency_hz / geometry.sound_speed_m_s * from_m);
    const auto echo = static_cast<float>(loud * std::sqrt(power) * wave *
                                         std::exp(-from_m * from_m / (2 * kThickM * kThickM)));
    for (std::size_t l = 0; l < frame.line_count; ++l) frame.samples[k + frame.sample_count * l] += echo;
  }
}

// So much gel above the tissue, which shows nothing but what echoes in the probe itself, alike in both
// frames; the tissue's surface is bright.
void put_gel_above(StatedFrames& frames, double gel_m, std::uint64_t seed) {
  const auto samples = static_cast<std::size_t>(gel_m / frames.geometry.sample_pitch_m());
  constexpr float kEcho = 60, kNoise = 5;  // of speckle of 2000
  for (RfFrame* frame : {&frames.pre, &frames.post}) {
    std::mt19937_64 echoes(seed), noise(seed + (frame == &frames.pre ? 1 : 2));
    std::normal_distribution<float> normal;
    RfFrame out{frame->sample_count + samples, frame->line_count, {}};
    for (std::size_t l = 0; l < frame->line_count; ++l) {
      for (std::size_t k = 0; k < samples; ++k)
        out.samples.push_back(kEcho * normal(echoes) + kNoise * normal(noise));
      const auto line = frame->samples.begin() + static_cast<std::ptrdiff_t>(l * frame->sample_count);
      out.samples.insert(out.samples.end(), line, line + static_cast<std::ptrdiff_t>(frame->sample_count));
    }
    *frame = std::move(out);
    draw_line(*frame, frames.geometry, gel_m, 20);
  }
}

}  // namespace

std::vector<WarningRow> frame_rows() {
  std::vector<WarningRow> rows;
  const auto row = [&](const char* name, std::vector<Claim> claims, auto change) {
    rows.push_back({name, std::move(claims), [change](std::uint64_t seed) {
                      WarnedWindow w;
                      w.frames = taken(seed);
                      change(*w.frames, seed);
                      return w;
                    }});
  };
  row("RF, 5 to 30 dB",
      {{WarningFlag::kImage, false},
       {WarningFlag::kAxis, false},
       {WarningFlag::kCoupling, false},
       {WarningFlag::kDisplacementFrame, false},
       {WarningFlag::kDisplacement, false},
       {WarningFlag::kCenterFrequency, false}},
      [](StatedFrames&, std::uint64_t) {});
  row("envelope for RF", {{WarningFlag::kImage, true}, {WarningFlag::kAxis, false}},
      [](StatedFrames& f, std::uint64_t) { detect(f.pre), detect(f.post); });
  row("lines for samples", {{WarningFlag::kAxis, true}, {WarningFlag::kImage, false}},
      [](StatedFrames& f, std::uint64_t) { turn(f.pre), turn(f.post); });
  row("3 to 8 mm of gel above a bright surface", {{WarningFlag::kCoupling, true}},
      [](StatedFrames& f, std::uint64_t seed) { put_gel_above(f, drawn(seed, 3e-3, 8e-3), seed); });
  row("a bright layer 3 to 8 mm deep", {{WarningFlag::kCoupling, false}},
      [](StatedFrames& f, std::uint64_t seed) {
        const double depth_m = drawn(seed, 3e-3, 8e-3);
        draw_line(f.pre, f.geometry, depth_m, 20);
        draw_line(f.post, f.geometry, depth_m * (1 - kSqueezeM / kFrameM), 20);
      });
  row("LAB stated for PROBE", {{WarningFlag::kDisplacementFrame, true}},
      [](StatedFrames& f, std::uint64_t) { f.geometry.frame = service::DisplacementFrame::kLab; });
  for (const double times : {1.7, 1 / 1.7})
    row(times > 1 ? "centre frequency stated 1.7 times too high"
                  : "centre frequency stated 1.7 times too low",
        {{WarningFlag::kCenterFrequency, true}},
        [times](StatedFrames& f, std::uint64_t) { f.geometry.center_frequency_hz *= times; });
  row("centre frequency stated 20 % off", {{WarningFlag::kCenterFrequency, false}},
      [](StatedFrames& f, std::uint64_t seed) {
        f.geometry.center_frequency_hz *= seed % 2 == 0 ? 1.2 : 1 / 1.2;
      });
  return rows;
}

}  // namespace teletact::bench
