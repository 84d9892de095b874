#include "client/recordings/recorded_set.h"

#include <gtest/gtest.h>

namespace teletact::client {
namespace {

std::string refusal(const RecordedSetOptions& options) {
  try {
    recorded_places(options);
  } catch (const FrameInputError& error) {
    return error.what();
  }
  return "";
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

}  // namespace
}  // namespace teletact::client
