// Tactile images of a recording, and their film strip.
#include <gtest/gtest.h>

#include <filesystem>

#include "client/link/recording.h"
#include "client/report/pictures.h"
#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

v1::TouchResponse answer(int k, bool image, float pressure_pa) {
  v1::TouchResponse out;
  v1::TouchAnswer& answer = *out.mutable_answer();
  answer.set_sequence(static_cast<std::uint64_t>(k));
  for (const double at : {0.05, 0.003}) answer.add_position_m(at);
  if (!image) return out;
  v1::TactileImage& tactile = *answer.mutable_tactile();
  for (const double at : {0.05, 0.0, 0.0}) tactile.add_centre_m(at);
  tactile.set_pitch_m(0.002);
  tactile.set_force_n(4e-6 * 4 * static_cast<double>(pressure_pa));
  for (v1::Array* array : {tactile.mutable_pressure_pa(), tactile.mutable_beyond_homogeneous_pa()}) {
    array->set_dtype(v1::DATA_TYPE_FLOAT32);
    array->add_shape(2), array->add_shape(2);
    const std::vector<float> values(4, pressure_pa);
    array->set_data(values.data(), values.size() * sizeof(float));
  }
  return out;
}

class FilmStrip : public testing::Test {
 protected:
  // With a pad; every `malformed`th image is of no pitch.
  TouchRecord recorded_touch(bool images, float pressure_pa, int malformed = 100) {
    const std::string path = (folder / "touch").string();
    v1::RecordHeader header;
    header.set_kind("touch");
    RecordWriter writer(path, header);
    v1::TouchRequest open;
    open.mutable_open()->mutable_fingertip()->set_shape(v1::FINGERTIP_SHAPE_PAD);
    writer.append(recorded(open, 0, 1));
    for (int k = 1; k <= 20; ++k) {
      v1::TouchResponse response = answer(k, images, pressure_pa);
      if (k % malformed == 0) response.mutable_answer()->mutable_tactile()->set_pitch_m(0);
      writer.append(recorded(response, 1'000'000'000LL * k, 1));
    }
    v1::RecordEntry tick;
    for (const double at : {0.05, 0.003}) tick.mutable_servo()->add_position_m(at);
    for (const double f : {0.0, 0.1}) tick.mutable_servo()->add_force_n(f);
    writer.append(tick);
    writer.close();
    return read_touch_record(path);
  }
  TemporaryFolder folder;
};

TEST_F(FilmStrip, IsDrawnOfTheImagesThatShowAContact) {
  const TouchRecord touch = recorded_touch(true, 1000);
  ASSERT_EQ(touch.tactile.size(), 20u);
  EXPECT_EQ(touch.tactile[3].arrived_s, 4);
  EXPECT_EQ(touch.tactile[3].image.pressure_pa, std::vector<float>(4, 1000));
  EXPECT_TRUE(draw_tactile(folder / "tactile.png", touch));
  EXPECT_GT(std::filesystem::file_size(folder / "tactile.png"), 1000u);
}

TEST_F(FilmStrip, LeavesOutAndCountsWhatIsMalformed) {
  const TouchRecord touch = recorded_touch(true, 1000, 5);
  EXPECT_EQ(touch.tactile.size(), 16u);
  EXPECT_EQ(touch.malformed_images, 4u);
  EXPECT_EQ(touch.answers.size(), 20u) << "its force is not";
  EXPECT_TRUE(draw_tactile(folder / "tactile.png", touch));
}

TEST_F(FilmStrip, IsOfAnyTipButTheTrueForceIsNotKnownUnderAPad) {
  const TouchRecord touch = recorded_touch(true, 1000);
  EXPECT_NE(touch.untold.find("touched with a pad or a sphere"), std::string::npos);
  try {
    force_error(Patient(Tissue{}, 0.002), touch);
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(error.what(), touch.untold);
  }
}

TEST_F(FilmStrip, IsNotDrawnOfARecordingWithoutImagesOrContact) {
  for (const bool images : {false, true}) {
    const TouchRecord touch = recorded_touch(images, 0);
    EXPECT_EQ(touch.tactile.empty(), !images);
    EXPECT_FALSE(draw_tactile(folder / "none.png", touch));
    EXPECT_FALSE(std::filesystem::exists(folder / "none.png"));
  }
}

}  // namespace
}  // namespace teletact::client
