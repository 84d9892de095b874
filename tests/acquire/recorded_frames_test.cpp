#include "client/acquire/recorded_frames.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "client/files/metaimage.h"
#include "tests/files/refusal.h"
#include "tests/files/temporary_folder.h"

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

std::string refusal(const RecordedFrameOptions& options) {
  return refusal_of<FrameInputError>([&] { read_recorded_frames(options); });
}

// On the wire 0 stands for the default, so a 0 that was asked for must not get there.
TEST(RecordedFrames, ValuesThatCannotBeAskedForAreRefusedByName) {
  RecordedFrameOptions good;
  good.center_frequency_hz = 7e6;
  good.sampling_frequency_hz = 40e6;
  good.frame = "LAB";
  EXPECT_NE(refusal(good).find("not a .mha, .mhd, .mat or .uff file"), std::string::npos)
      << "all but the files is good";
  for (const double nu : {0.0, 0.5, -0.1, static_cast<double>(NAN)}) {
    RecordedFrameOptions options = good;
    options.poisson_ratio = nu;
    EXPECT_NE(refusal(options).find("--poisson-ratio"), std::string::npos) << nu;
  }
  for (const double strain : {0.0, 0.0009, 0.126, static_cast<double>(NAN)}) {
    RecordedFrameOptions options = good;
    options.max_strain = strain;
    EXPECT_NE(refusal(options).find("--max-strain"), std::string::npos) << strain;
  }
}

// A method of planes makes the tissue a plane, which has no length across the image.
TEST(RecordedFrames, AProbesLengthIsRefusedWhereNothingIsSolid) {
  RecordedFrameOptions good;
  good.center_frequency_hz = 7e6;
  good.sampling_frequency_hz = 40e6;
  good.frame = "LAB";
  good.probe_elevation_m = 0.005;
  EXPECT_EQ(refusal(good).find("--probe-elevation-m"), std::string::npos);
  for (const auto method : {v1::MODULUS_METHOD_DIRECT, v1::MODULUS_METHOD_ITERATIVE}) {
    RecordedFrameOptions options = good;
    options.modulus_method = method;
    EXPECT_NE(refusal(options).find("--probe-elevation-m"), std::string::npos);
    EXPECT_NE(refusal(options).find("--modulus-method"), std::string::npos) << "what made it a plane";
  }
  RecordedFrameOptions options = good;
  options.plane = v1::PLANE_CONDITION_STRESS;
  EXPECT_NE(refusal(options).find("leave it out, or --plane"), std::string::npos);
}

TEST(ModulusDoubt, AsksForTheUnitWhereNoSoftTissueIsLikeThat) {
  for (const double background_pa : {101.0, 9812.0, 9e5, static_cast<double>(NAN)})
    EXPECT_EQ(modulus_doubt(background_pa), "");
  EXPECT_EQ(modulus_doubt(9812256.0),
            "background 9812 kPa: no soft tissue is that stiff; is --force-n in newtons, and "
            "--contact-area-m2 in square metres (1 cm^2 is 1e-4), or a pad's modulus in pascals?");
  EXPECT_NE(modulus_doubt(9.8).find("background 9.8 Pa: no soft tissue is that soft"), std::string::npos);
}

TEST(RecordedFrames, WhatIsOfAnotherKindOfFileIsRefusedByName) {
  const TemporaryFolder folder;
  RecordedFrameOptions options;
  options.center_frequency_hz = 7e6;
  options.frame = "LAB";
  options.pre = options.post = folder / "a.mha";
  EXPECT_NE(refusal(options).find("--sampling-frequency-hz"), std::string::npos) << refusal(options);
  options.modulation_frequency_hz = 7e6;
  EXPECT_NE(refusal(options).find("--modulation-frequency-hz"), std::string::npos) << refusal(options);
  options.modulation_frequency_hz = -1;
  EXPECT_NE(refusal(options).find("0 or more"), std::string::npos) << refusal(options);
  options.modulation_frequency_hz.reset();
  options.pre = folder / "a.mat";
  EXPECT_NE(refusal(options).find("--sampling-frequency-hz"), std::string::npos) << refusal(options);
}

// Options for one file of 64 samples x 8 lines.
RecordedFrameOptions one_file(const TemporaryFolder& folder, std::vector<double> spacing,
                              std::vector<double> origin = {}) {
  RecordedFrameOptions options;
  options.center_frequency_hz = 7e6;
  options.sampling_frequency_hz = 38.5e6;  // 20 um per sample
  options.frame = "LAB";
  options.pre = options.post = folder / "a.mha";
  write_metaimage(options.pre, MetaImage::of<std::int16_t>({64, 8}, std::move(spacing), std::move(origin),
                                                           std::vector<std::int16_t>(64 * 8, 0x101)));
  return options;
}

TEST(RecordedFrames, LengthsAreInTheUnitStated) {
  const TemporaryFolder folder;
  for (const auto& [unit, per_m] : {std::pair("m", 1.0), std::pair("mm", 1000.0)}) {
    RecordedFrameOptions options = one_file(folder, {2e-5 * per_m, 0.0003 * per_m}, {0.0015 * per_m, 0});
    options.spacing_unit = unit;
    const v1::Acquisition acquisition = read_recorded_frames(options).acquisition;
    EXPECT_NEAR(acquisition.line_pitch_m(), 0.0003, 1e-12) << unit;
    EXPECT_NEAR(acquisition.first_sample_depth_m(), 0.0015, 1e-12) << unit;
  }
}

// What is not stated is sent all the same, so that the record of an estimate says what it was made with.
TEST(RecordedFrames, DefaultsAreSent) {
  const TemporaryFolder folder;
  const v1::Acquisition acquisition = read_recorded_frames(one_file(folder, {2e-5, 0.0003})).acquisition;
  EXPECT_EQ(acquisition.poisson_ratio(), 0.49);
  EXPECT_EQ(acquisition.max_strain(), 0.05);
  EXPECT_EQ(acquisition.plane(), v1::PLANE_CONDITION_SOLID);
}

TEST(TissueExtent, OfASolidIsNotAssumed) {
  v1::Acquisition acquisition = phantom();
  acquisition.set_plane(v1::PLANE_CONDITION_SOLID);
  acquisition.set_tissue_depth_m(0.05);
  const TissueExtent extent = tissue_extent(acquisition);
  EXPECT_EQ(extent.width_m, 0);
  EXPECT_EQ(extent.depth_m, 0.05);
  EXPECT_FALSE(extent.width_assumed);
  EXPECT_FALSE(extent.depth_assumed);
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
