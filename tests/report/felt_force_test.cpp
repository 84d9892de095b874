// What was felt, what was stated of it, and the picture of both.
#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <optional>

#include "client/report/force_error.h"
#include "client/report/pictures.h"
#include "tests/files/read_png.h"
#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

constexpr std::array<std::uint8_t, 3> kBand{0xf0, 0xb8, 0xa8}, kFelt{0xc0, 0x30, 0x20},
    kTrue{0x99, 0x99, 0x99};

// 1 N for 3 s along 30 mm, 2 mm deep. Answers every 10 ms, of where the finger was 5 ms before.
TouchRecord touch(std::optional<ForceInterval> stated) {
  TouchRecord record;
  for (double t = 0; t < 3; t += 0.01) {
    TouchTick tick;
    tick.time_s = 100 + t, tick.x_m = 0.03 + 0.01 * t, tick.indentation_m = 0.002;
    tick.force_y_n = -1, tick.enabled = true;
    record.ticks.push_back(tick);
    TouchAnswerTime& answer = record.answers.emplace_back();
    answer.arrived_s = tick.time_s - 0.001, answer.x_m = tick.x_m - 5e-5, answer.stated = stated;
  }
  return record;
}

TEST(FeltForce, HasWhatTheNewestAnswerOfItsPlaceStates) {
  TouchRecord record = touch(ForceInterval{0.1});
  for (TouchAnswerTime& answer : record.answers) {
    if (answer.arrived_s > 101) answer.stated = {0.3, 0.1};
    if (answer.arrived_s > 102) answer.stated.reset();
    if (answer.arrived_s > 102.5) answer.stated = {0.2}, answer.z_m = 0.003;
  }
  const auto felt = felt_force(record);
  ASSERT_GT(felt.size(), 150u) << "the ramp is left out";
  for (const ForceSamplePoint& p : felt) {
    EXPECT_EQ(p.felt_n, 1);
    EXPECT_FALSE(p.true_n);
    std::optional<ForceInterval> stated;
    if (p.time_s < 102.005) stated = p.time_s < 101.005 ? ForceInterval{0.1} : ForceInterval{0.3, 0.1};
    EXPECT_EQ(p.stated, stated) << p.time_s;
  }
  record = touch(ForceInterval{0.1});
  record.answers.erase(record.answers.begin(), record.answers.end() - 100);
  EXPECT_FALSE(felt_force(record).front().stated) << "no answer had come";
  EXPECT_EQ(felt_force(record).back().stated, ForceInterval{0.1});
}

class ForcePicture : public testing::Test {
 protected:
  Pixels of(std::vector<ForceSamplePoint> force) {
    EXPECT_TRUE(draw_force(folder / "force.png", force));
    return read_png(folder / "force.png");
  }
  TemporaryFolder folder;
};

TEST_F(ForcePicture, ShowsTheBandThatIsStated) {
  const auto narrow = felt_force(touch(ForceInterval{0.05})), wide = felt_force(touch(ForceInterval{0.4}));
  const std::size_t of_narrow = count_of(of(narrow), kBand), of_wide = count_of(of(wide), kBand);
  EXPECT_GT(of_narrow, 1000u);
  EXPECT_GT(of_wide, 4 * of_narrow);
  const Pixels none = of(felt_force(touch({})));
  EXPECT_EQ(count_of(none, kBand), 0u);
  EXPECT_GT(count_of(none, kFelt), 20u) << "a thin line, blended with what is around";
  EXPECT_LT(count_of(none, kTrue), 100u) << "letters have such a grey, too";
}

TEST_F(ForcePicture, ShowsNoBandWhereNothingIsStated) {
  auto force = felt_force(touch(ForceInterval{0.4}));
  const std::size_t whole = count_of(of(force), kBand);
  for (std::size_t k = force.size() / 4; k < 3 * force.size() / 4; ++k) force[k].stated.reset();
  const std::size_t half = count_of(of(force), kBand);
  EXPECT_GT(half, 0.4 * double(whole));
  EXPECT_LT(half, 0.6 * double(whole));
}

TEST_F(ForcePicture, ShowsTheTrueForceWhereItIsKnown) {
  auto force = felt_force(touch(ForceInterval{0.1}));
  for (ForceSamplePoint& p : force) p.true_n = 1.3;
  EXPECT_GT(count_of(of(force), kTrue), 1000u);
}

TEST_F(ForcePicture, IsNotDrawnOfNothing) {
  EXPECT_FALSE(draw_force(folder / "force.png", {}));
  EXPECT_FALSE(std::filesystem::exists(folder / "force.png"));
}

}  // namespace
}  // namespace teletact::client
