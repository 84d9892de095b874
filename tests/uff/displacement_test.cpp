// A simulated patient's frames as a beamformer's IQ, in a file of USTB: read, made RF and tracked, they show
// the displacement that their RF shows.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "client/acquire/recorded_frames.h"
#include "client/patient/rf.h"
#include "service/imaging/tracking/displacement.h"
#include "tests/files/matlab/write_uff.h"
#include "tests/files/temporary_folder.h"
#include "tests/imaging/imaging_device.h"
#include "tests/uff/recorded_image.h"

namespace teletact {
namespace {

constexpr double kWindowM = 0.12, kPushM = 0.0004;

client::Tissue tissue() {
  client::Tissue t;
  t.inclusions = {{0.15, 0.014, 0.010, 4}};
  return t;
}

const client::ProbeState& pressed() {
  static const client::Patient patient(tissue());
  static const client::ProbeState probe = patient.press(kWindowM, kPushM);
  return probe;
}

service::RfFrame frame_of(const client::FramePair& pair, const std::string& bytes) {
  service::RfFrame out{pair.acquisition.sample_count(), pair.acquisition.line_count(), {}};
  out.samples.resize(out.sample_count * out.line_count);
  EXPECT_EQ(bytes.size(), out.samples.size() * sizeof(float));
  std::memcpy(out.samples.data(), bytes.data(), bytes.size());
  return out;
}

struct Error {
  double rmse_m = 0, trusted = 0;
};

// Of the axial displacement at the trusted nodes, 2 mm from the frame's ends, against the patient's own.
Error error_of(const service::RfFrame& pre, const service::RfFrame& post,
               const service::AcquisitionGeometry& g) {
  const service::Queue queue = service::imaging_device()->queue();
  service::DisplacementEstimator estimator(queue, {});
  const service::DisplacementEstimate e = estimator.estimate(pre, post, g);
  const auto field = queue.read(e.field_m);
  const auto trusted = queue.read(e.trusted);
  const service::ImageGrid grid = service::image_grid(e.grid, g);
  Error out;
  double judged = 0, squares = 0, trusts = 0;
  for (std::size_t n = 0; n < grid.size(); ++n) {
    const double x = grid.x_m(n), y = grid.y_m(n);
    if (x < 0.002 || x > 0.058 || y < 0.002 || y > 0.038) continue;
    ++judged;
    if (!trusted[n]) continue;
    const auto moved = pressed().field->at(kWindowM + x, y);
    ++trusts, squares += std::pow(field[2 * n + 1] - (moved.y - kPushM), 2);
  }
  out.rmse_m = std::sqrt(squares / trusts), out.trusted = trusts / judged;
  return out;
}

TEST(UffDisplacement, OfIqIsThatOfTheRf) {
  const client::Tissue t = tissue();
  const client::RfPair rf =
      client::with_noise(client::simulate_rf(t, pressed(), client::RfFrame::kProbe, 5), 6);
  const std::size_t n = rf.geometry.sample_count, lines = rf.geometry.line_count;
  service::AcquisitionGeometry g;
  g.center_frequency_hz = t.ultrasound.center_frequency_hz;
  g.sampling_frequency_hz = t.ultrasound.sampling_frequency_hz;
  g.line_pitch_m = rf.geometry.line_pitch_m;
  const std::vector<float> pre(rf.pre.begin(), rf.pre.end()), post(rf.post.begin(), rf.post.end());
  const Error own = error_of({n, lines, pre}, {n, lines, post}, g);
  std::printf("RF at %.1f MHz: RMSE %.2f um, %.3f trusted\n", g.sampling_frequency_hz * 1e-6,
              own.rmse_m * 1e6, own.trusted);

  const client::TemporaryFolder folder;
  constexpr std::size_t kEvery = 4;
  const double iq_hz = 6.5e6;  // what the scanner shifted down by, near the pulse's own
  {
    client::UffFile file(folder / "a.uff");
    std::vector<float> real, imaginary;
    std::size_t samples = 0;
    for (const auto& frame : {pre, post}) {
      const auto one = client::demodulated(frame, n, g.sampling_frequency_hz, iq_hz, 5e6, kEvery);
      samples = one.samples;
      real.insert(real.end(), one.real.begin(), one.real.end());
      imaginary.insert(imaginary.end(), one.imaginary.begin(), one.imaginary.end());
    }
    client::write_beamformed(file, "b_data",
                             {lines, samples, g.line_pitch_m, kEvery * rf.geometry.sample_pitch_m, 0}, real,
                             imaginary);
    file.number("b_data/modulation_frequency", iq_hz);
  }
  client::RecordedFrameOptions options;
  options.pre = options.post = folder / "a.uff";
  options.center_frequency_hz = g.center_frequency_hz;
  options.frame = "PROBE";
  EXPECT_THROW(client::read_recorded_frames(options), client::FrameInputError) << "which of two frames?";
  options.pre_frame = 0, options.post_frame = 1;
  const client::FramePair pair = client::read_recorded_frames(options);
  EXPECT_NEAR(pair.acquisition.line_pitch_m(), g.line_pitch_m, 1e-8);
  EXPECT_EQ(pair.acquisition.dtype(), v1::DATA_TYPE_FLOAT32);
  g.sampling_frequency_hz = pair.acquisition.sampling_frequency_hz();
  const Error of_iq = error_of(frame_of(pair, pair.pre), frame_of(pair, pair.post), g);
  std::printf("%s: RMSE %.2f um, %.3f trusted\n", pair.made.c_str(), of_iq.rmse_m * 1e6, of_iq.trusted);
  EXPECT_LT(of_iq.rmse_m, 1.2 * own.rmse_m);
  EXPECT_GT(of_iq.trusted, own.trusted - 0.01);

  options.sampling_frequency_hz = 10e6;  // the IQ's: contradicts
  EXPECT_THROW(client::read_recorded_frames(options), client::FrameInputError);
}

}  // namespace
}  // namespace teletact
