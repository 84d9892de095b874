// A window of the simulated patient (T2.7: 60 x 40 mm, 30 dB, rho .99), whose truth comes from another FEM on
// another mesh and whose RF from another simulator: what the modulus map must show of it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <optional>
#include <vector>

#include "client/patient/rf.h"
#include "service/imaging/estimate.h"
#include "tests/imaging/imaging_device.h"

namespace teletact::service {
namespace {

constexpr double kWindowM = 0.120, kPushM = 0.0004;
constexpr double kBackgroundPa = 10e3;

client::Tissue tissue() {
  client::Tissue t;
  t.inclusions = {{0.134, 0.012, 0.008, 3}, {0.157, 0.016, 0.012, 8}};
  return t;
}

Estimate estimate(const client::Tissue& t, client::RfFrame frame) {
  static const client::Patient patient(t);
  const client::ProbeState probe = patient.press(kWindowM, kPushM);
  const client::RfPair rf = client::with_noise(client::simulate_rf(t, probe, frame, 5), 6);
  const auto of = [&](const std::vector<std::int16_t>& samples) {
    return RfFrame{rf.geometry.sample_count, rf.geometry.line_count, {samples.begin(), samples.end()}};
  };
  AcquisitionGeometry g;
  g.center_frequency_hz = t.ultrasound.center_frequency_hz;
  g.sampling_frequency_hz = t.ultrasound.sampling_frequency_hz;
  g.line_pitch_m = rf.geometry.line_pitch_m;
  g.frame = frame == client::RfFrame::kLab ? DisplacementFrame::kLab : DisplacementFrame::kProbe;
  Elastography elastography(imaging_device());
  return elastography.estimate(of(rf.pre), of(rf.post),
                               {g,
                                ProbeForce{probe.force_n, probe.contact_area_m2},
                                {t.width_m, t.depth_m, kWindowM, t.poisson_ratio}});
}

double median(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

class PatientWindow : public ::testing::TestWithParam<client::RfFrame> {};

TEST_P(PatientWindow, ShowsItsInclusionsAndNothingElse) {
  const client::Tissue t = tissue();
  const Estimate e = estimate(t, GetParam());
  std::vector<std::vector<double>> inside(t.inclusions.size());
  std::vector<double> background;
  double stiff = 0, squares = 0, judged = 0;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    if (!e.valid[n]) continue;
    const double x = kWindowM + e.grid.origin_x_m + static_cast<double>(n % e.grid.nx) * e.grid.dx_m;
    const double y = e.grid.origin_y_m + static_cast<double>(n / e.grid.nx) * e.grid.dy_m;
    bool apart = true, rim = false;
    double truth_pa = kBackgroundPa;
    for (std::size_t k = 0; k < inside.size(); ++k) {
      const client::Inclusion& i = t.inclusions[k];
      const double radii = 2 * std::hypot(x - i.x_m, y - i.y_m) / i.diameter_m;
      if (radii < 0.7) inside[k].push_back(e.modulus.youngs_modulus[n]);
      apart &= (radii - 1) * i.diameter_m / 2 > 0.003;
      rim |= std::abs(radii - 1) * i.diameter_m / 2 < 0.001;
      if (radii < 1) truth_pa *= i.contrast;
    }
    ASSERT_TRUE(std::isfinite(e.modulus.log_deviation[n]) && e.modulus.log_deviation[n] > 0) << n;
    if (!rim)
      squares += std::pow(std::log(e.modulus.youngs_modulus[n] / truth_pa) / e.modulus.log_deviation[n], 2);
    judged += !rim;
    if (!apart) continue;
    background.push_back(e.modulus.youngs_modulus[n]);
    stiff += e.modulus.youngs_modulus[n] > 1.5 * kBackgroundPa;
  }
  EXPECT_GE(e.valid_fraction, 0.75);
  EXPECT_NEAR(median(background), kBackgroundPa, 0.06 * kBackgroundPa);
  EXPECT_LE(stiff / static_cast<double>(background.size()), 0.01);
  EXPECT_GE(median(inside[0]), 2.0 * kBackgroundPa);  // of 3
  EXPECT_LE(median(inside[0]), 3.3 * kBackgroundPa);
  EXPECT_GE(median(inside[1]), 4.5 * kBackgroundPa);  // of 8
  EXPECT_LE(median(inside[1]), 9.0 * kBackgroundPa);
  // The errors are as large as claimed, 1 mm from a rim and more.
  const double standardised = std::sqrt(squares / judged);
  EXPECT_GE(standardised, 0.5);
  EXPECT_LE(standardised, 2);
  for (std::size_t n = 0; n < e.grid.size(); ++n)
    ASSERT_EQ(std::isnan(e.modulus.log_deviation[n]), e.valid[n] == 0) << n;
  std::printf("background %.0f Pa, inclusions %.0f, %.0f Pa; %.3f valid, standardised error %.2f\n",
              median(background), median(inside[0]), median(inside[1]), e.valid_fraction, standardised);
}

INSTANTIATE_TEST_SUITE_P(Frames, PatientWindow,
                         ::testing::Values(client::RfFrame::kLab, client::RfFrame::kProbe));

}  // namespace
}  // namespace teletact::service
