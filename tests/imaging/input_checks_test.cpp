// What a request states about its frames, against the frames.
#include "service/imaging/input_checks.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "service/imaging/estimate.h"
#include "tests/imaging/imaging_device.h"
#include "tests/imaging/speckle.h"

namespace teletact::service {
namespace {

constexpr double kStrain = -0.012, kDepthM = 0.020;
constexpr std::size_t kSamples = 1039, kLines = 85;  // 20 x 20 mm

Speckle tissue(double snr_db) {
  SpeckleOptions options;
  options.samples = kSamples;
  options.lines = kLines;
  options.snr_db = snr_db;
  options.correlation = 0.99;
  return Speckle(options);
}

// A pair whose side at `rest_y_m` rests.
std::vector<std::string> warnings(double rest_y_m, const AcquisitionGeometry& geometry) {
  static const Speckle speckle = tissue(30);
  static Elastography elastography(imaging_device());
  const RfFrame pre = speckle.frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
  const RfFrame post = speckle.frame(
      [=](double, double y) {
        return std::pair{0.0, kStrain * (y - rest_y_m)};
      },
      2);
  const TissueExtent extent{static_cast<double>(kLines) * geometry.line_pitch_m, kDepthM, 0, 0.0};
  return elastography
      .estimate(pre, post, geometry, std::nullopt, extent, {}, {}, {}, {ModulusKind::kReferenceStress, {}})
      .input_warnings;
}

TEST(InputChecks, MeanFrequencyIsThatOfTheEcho) {
  for (const double snr_db : {10.0, 40.0}) {
    const RfFrame frame = tissue(snr_db).frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
    EXPECT_NEAR(mean_frequency(frame, 40e6), 7.3e6, 0.1 * 7.3e6) << snr_db;
  }
  EXPECT_TRUE(std::isnan(mean_frequency({64, 2, std::vector<float>(128, 3.f)}, 40e6)));
}

TEST(InputChecks, TheFrameThatRestsWhereItSaysIsNotDoubted) {
  AcquisitionGeometry geometry = speckle_geometry();
  geometry.frame = DisplacementFrame::kProbe;
  EXPECT_EQ(warnings(0, geometry), std::vector<std::string>{});
  geometry.frame = DisplacementFrame::kLab;
  EXPECT_EQ(warnings(kDepthM, geometry), std::vector<std::string>{});
  EXPECT_EQ(warnings(2 * kDepthM, geometry), std::vector<std::string>{})
      << "the frame ends above the far side";
}

TEST(InputChecks, TheOtherFrameIsNamed) {
  AcquisitionGeometry geometry = speckle_geometry();
  geometry.frame = DisplacementFrame::kLab;
  auto said = warnings(0, geometry);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_EQ(said[0].rfind("displacement_frame: LAB is stated", 0), 0u) << said[0];
  geometry.frame = DisplacementFrame::kProbe;
  said = warnings(kDepthM, geometry);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_EQ(said[0].rfind("displacement_frame: PROBE is stated", 0), 0u) << said[0];
}

TEST(InputChecks, ACentreFrequencyThatTheEchoesDoNotHaveIsNamed) {
  AcquisitionGeometry geometry = speckle_geometry();
  geometry.center_frequency_hz = 3.5e6;
  const auto said = warnings(0, geometry);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_EQ(said[0].rfind("center_frequency_hz: 3.5 MHz is stated", 0), 0u) << said[0];
}

}  // namespace
}  // namespace teletact::service
