// Recordings read as solids.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <utility>
#include <vector>

#include "service/imaging/estimate.h"
#include "tests/data/recorded_pairs.h"

namespace teletact::service {
namespace {

Estimate solid(const RecordedPair& pair) {
  const double width_m = static_cast<double>(pair.pre.line_count) * pair.geometry.line_pitch_m;
  TissueExtent extent{width_m, 0.055, 0, 0.49, Plane::kSolid};
  extent.depth_stated = false;
  static Elastography elastography(Device::open());
  return elastography.estimate(pair.pre, pair.post, {pair.geometry, std::nullopt, extent, {}, {{}, 60.0}});
}

double typical(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

TEST(PhantomS2000, IsTakenForABlockWithoutARamp) {
  SKIP_WITHOUT_DATA("phantom-s2000");
  const Estimate e = solid(phantom_s2000());
  EXPECT_NE(e.modulus.model.find("that is a block"), std::string::npos) << e.modulus.model;
  for (std::size_t n = 0; n < e.grid.size(); ++n) EXPECT_FALSE(e.valid[n] && y_of(e, n) < 0.0058) << n;
  ASSERT_FALSE(e.input_warnings.empty());
  EXPECT_EQ(e.input_warnings.back().flag, WarningFlag::kCoupling) << e.input_warnings.back().line();
  std::vector<double> above, below, deviations;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    if (!e.valid[n] || y_of(e, n) < 0.007) continue;
    deviations.push_back(e.modulus.log_deviation[n]);
    if (std::hypot(x_of(e, n) - 0.0197, y_of(e, n) - 0.0355) < 0.009) continue;  // the sphere
    if (y_of(e, n) < 0.022) above.push_back(e.modulus.youngs_modulus[n]);
    if (y_of(e, n) > 0.040) below.push_back(e.modulus.youngs_modulus[n]);
  }
  std::printf("phantom-s2000: ramp %.2f, deviation %.2f; %s\n", typical(below) / typical(above),
              typical(deviations), e.modulus.model.c_str());
  EXPECT_NEAR(std::log(typical(below) / typical(above)), 0, std::log(1.2));
  EXPECT_LE(typical(deviations), 0.2);
}

// What a block's columns differ by adds up where it is not held: the swapped pair read 1.40 then.
TEST(PhantomS2000, SwappedOrWithHalfOfItsSamplesItReadsAlike) {
  SKIP_WITHOUT_DATA("phantom-s2000");
  const RecordedPair whole = phantom_s2000();
  RecordedPair swapped = whole, half = whole;
  std::swap(swapped.pre, swapped.post);
  half.geometry.sampling_frequency_hz /= 2;
  for (RfFrame* frame : {&half.pre, &half.post}) {  // an even count
    frame->sample_count /= 2;
    for (std::size_t n = 0; n < frame->samples.size() / 2; ++n) frame->samples[n] = frame->samples[2 * n + 1];
    frame->samples.resize(frame->samples.size() / 2);
  }
  const auto contrast = [](const Estimate& e) {
    std::vector<double> inside, beside;
    for (std::size_t n = 0; n < e.grid.size(); ++n) {
      const double across_m = std::abs(x_of(e, n) - 0.0197);
      if (!e.valid[n] || std::abs(y_of(e, n) - 0.0355) > 0.001) continue;
      if (across_m < 0.002) inside.push_back(e.modulus.youngs_modulus[n]);
      if (across_m > 0.009 && across_m < 0.016) beside.push_back(e.modulus.youngs_modulus[n]);
    }
    EXPECT_TRUE(e.modulus.converged);
    return typical(inside) / typical(beside);
  };
  const double of_whole = contrast(solid(whole)), of_swapped = contrast(solid(swapped)),
               of_half = contrast(solid(half));
  std::printf("phantom-s2000: contrast %.2f, swapped %.2f, half-sampled %.2f\n", of_whole, of_swapped,
              of_half);
  EXPECT_NEAR(of_swapped / of_whole, 1, 0.1);
  EXPECT_NEAR(of_half / of_whole, 1, 0.1);
}

}  // namespace
}  // namespace teletact::service
