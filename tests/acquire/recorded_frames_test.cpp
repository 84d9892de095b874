#include "client/acquire/recorded_frames.h"

#include <gtest/gtest.h>

namespace teletact::client {
namespace {

v1::Acquisition phantom() {
  v1::Acquisition acquisition;
  acquisition.set_sample_count(2000);
  acquisition.set_line_count(100);
  acquisition.set_sampling_frequency_hz(38.5e6);  // 20 um per sample
  acquisition.set_sound_speed_m_s(1540);
  acquisition.set_line_pitch_m(0.0003);
  acquisition.set_first_sample_depth_m(0.002);
  return acquisition;
}

TEST(TissueExtent, IsTheFramesWhereNothingIsStatedAndSaysSo) {
  const TissueExtent extent = tissue_extent(phantom());
  EXPECT_NEAR(extent.width_m, 0.030, 1e-12);
  EXPECT_NEAR(extent.depth_m, 0.042, 1e-12);
  EXPECT_TRUE(extent.width_assumed);
  EXPECT_TRUE(extent.depth_assumed);
}

TEST(TissueExtent, IsAsStated) {
  v1::Acquisition acquisition = phantom();
  acquisition.set_tissue_width_m(0.2);
  acquisition.set_tissue_depth_m(0.05);
  const TissueExtent extent = tissue_extent(acquisition);
  EXPECT_EQ(extent.width_m, 0.2);
  EXPECT_EQ(extent.depth_m, 0.05);
  EXPECT_FALSE(extent.width_assumed);
  EXPECT_FALSE(extent.depth_assumed);
}

}  // namespace
}  // namespace teletact::client
