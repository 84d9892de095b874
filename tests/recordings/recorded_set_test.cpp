#include "client/recordings/recorded_set.h"

#include <gtest/gtest.h>

#include "client/files/metaimage.h"
#include "tests/files/refusal.h"
#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

std::string refusal(const RecordedSetOptions& options) {
  return refusal_of<FrameInputError>([&] { recorded_places(options); });
}

TEST(RecordedSet, AnOptionIsGivenOnceOrForEachPair) {
  RecordedSetOptions options;
  options.pre = {"rest.mha"};
  options.post = {"a.mha", "b.mha", "c.mha"};
  options.force_n = {1, 2, 3};
  const auto places = recorded_places(options);
  ASSERT_EQ(places.size(), 1u);
  EXPECT_FALSE(places[0].z_m);
  ASSERT_EQ(places[0].pairs.size(), 3u);
  EXPECT_EQ(places[0].pairs[2].pre, "rest.mha");
  EXPECT_EQ(places[0].pairs[2].post, "c.mha");
  EXPECT_EQ(places[0].pairs[1].force_n, 2);
  options.pre = {"rest.mha", "rest.mha"};
  EXPECT_EQ(refusal(options), "--pre is given 2 times, --post 3: give each once, or once for each pair");
}

TEST(RecordedSet, FramesOfOneFileAreCounted) {
  RecordedSetOptions options;
  options.pre = options.post = {"all.mat"};
  options.pre_frame = {0};
  options.post_frame = {10, 20};
  const auto places = recorded_places(options);
  ASSERT_EQ(places[0].pairs.size(), 2u);
  EXPECT_EQ(places[0].pairs[1].pre_frame, 0u);
  EXPECT_EQ(places[0].pairs[1].post_frame, 20u);
}

TEST(RecordedSet, PairsOfOnePlaneAreTogetherAndPlanesInOrder) {
  RecordedSetOptions options;
  options.pre = options.post = {"all.mat"};
  options.pre_frame = {0, 2, 4, 6};
  options.post_frame = {1, 3, 5, 7};
  options.z_m = {0.010, 0, 0.005, 0};
  const auto places = recorded_places(options);
  ASSERT_EQ(places.size(), 3u);
  EXPECT_EQ(places[0].pairs.size(), 2u);
  EXPECT_EQ(places[0].pairs[1].pre_frame, 6u);
  EXPECT_EQ(*places[2].z_m, 0.010);
  options.z_m = {0, 0.005, 0.010, 0.030};
  EXPECT_NE(refusal(options).find("--z-m: planes at"), std::string::npos) << refusal(options);
  options.z_m = {0.005};
  EXPECT_NE(refusal(options).find("--z-m is given once"), std::string::npos) << refusal(options);
}

class RecordedGeometry : public testing::Test {
 protected:
  // A file of 64 samples x `lines` lines, 20 um and `pitch_m` apart.
  std::filesystem::path file(const std::string& name, double depth_m = 0.002, double pitch_m = 0.0003,
                             std::size_t lines = 8) {
    write_metaimage(folder_ / name,
                    MetaImage::of<std::int16_t>({64, lines}, {2e-5, pitch_m}, {depth_m, 0},
                                                std::vector<std::int16_t>(64 * lines, 0x101)));
    return folder_ / name;
  }
  // Of two pairs, of which the first is as usual.
  std::string refusal(const std::filesystem::path& second) {
    RecordedSetOptions options;
    options.common.center_frequency_hz = 7e6;
    options.common.sampling_frequency_hz = 38.5e6;
    options.common.frame = "LAB";
    options.pre = options.post = {file("first.mha"), second};
    return refusal_of<FrameInputError>([&] { require_one_geometry(recorded_places(options)); });
  }
  const TemporaryFolder folder_;
};

TEST_F(RecordedGeometry, IsThatOfTheFirstPair) {
  EXPECT_EQ(refusal(file("b.mha")), "no error");
  EXPECT_NE(refusal(file("b.mha", 0.007)).find("b.mha has another line pitch, first depth"),
            std::string::npos);
  EXPECT_NE(refusal(file("b.mha", 0.002, 0.0004)).find("b.mha has another line pitch"), std::string::npos);
  EXPECT_NE(refusal(file("b.mha", 0.002, 0.0003, 9)).find("64 samples x 9 lines"), std::string::npos);
}

}  // namespace
}  // namespace teletact::client
