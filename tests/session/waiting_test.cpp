#include "client/session/waiting.h"

#include <gtest/gtest.h>

#include <vector>

namespace teletact::client {
namespace {

// Lines and their times, looked at every 20 ms.
std::vector<std::pair<double, std::string>> lines(Waiting& waiting, const TouchSituation& situation,
                                                  double from_s, double to_s) {
  std::vector<std::pair<double, std::string>> said;
  for (int n = 0; from_s + 0.02 * n < to_s; ++n) {
    const std::string message = waiting.message(situation, from_s + 0.02 * n);
    if (!message.empty()) said.emplace_back(from_s + 0.02 * n, message);
  }
  return said;
}

TEST(Waiting, SaysNothingWhileThereIsForce) {
  Waiting waiting;
  EXPECT_TRUE(lines(waiting, {.state = ServoState::kEnabled}, 0, 100).empty());
}

TEST(Waiting, NamesTheServicesTroubleEveryFewSeconds) {
  Waiting waiting;
  const auto said = lines(waiting, {.trouble = "NOT_FOUND: no scene"}, 100, 120);
  ASSERT_EQ(said.size(), 4u);  // at 3, 8, 13 and 18 s
  EXPECT_NEAR(said[0].first, 103, 0.05);
  EXPECT_NEAR(said[3].first, 118, 0.1);
  EXPECT_NE(said[0].second.find("NOT_FOUND: no scene"), std::string::npos);
}

TEST(Waiting, AsksForTheButtonAndNamesThePlaceThatNobodyAcquires) {
  Waiting waiting;
  auto said = lines(waiting, {.state = ServoState::kPaused}, 0, 40);
  ASSERT_EQ(said.size(), 2u);  // at 3 and 33 s
  EXPECT_NE(said[0].second.find("button"), std::string::npos);
  const TouchSituation held{.state = ServoState::kEnabled, .held_at_border = true, .x_m = 0.0594};
  said = lines(waiting, held, 40, 80);
  ASSERT_EQ(said.size(), 2u);
  EXPECT_NEAR(said[0].first, 43, 0.05);
  EXPECT_NEAR(said[1].first, 73, 0.1);
  EXPECT_NE(said[0].second.find("x = 0.059 m"), std::string::npos) << said[0].second;
  const TouchSituation uncovered{.state = ServoState::kEnabled, .covered = false};
  EXPECT_EQ(lines(waiting, uncovered, 80, 104).size(), 1u)
      << "the same wait goes on: its next line is due at 103";
}

TEST(Waiting, NamesADeviceThatCannotBeReadAndTheButtonOnceItCan) {
  Waiting waiting;
  const auto said = lines(waiting, {.state = ServoState::kFault, .device_ok = false}, 0, 10);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_NE(said[0].second.find("waiting for the device"), std::string::npos) << said[0].second;
  EXPECT_EQ(said[0].second.find("button"), std::string::npos);
  const auto back = lines(waiting, {.state = ServoState::kFault}, 10, 20);
  ASSERT_EQ(back.size(), 1u);
  EXPECT_NE(back[0].second.find("button"), std::string::npos);
}

// A hand that waits now and then for a moment is not spoken of.
TEST(Waiting, ShortStopsAreNotTold) {
  Waiting waiting;
  for (int n = 0; n < 20; ++n) {
    EXPECT_TRUE(
        lines(waiting, {.state = ServoState::kEnabled, .held_at_border = true}, 4 * n, 4 * n + 2).empty());
    EXPECT_TRUE(lines(waiting, {.state = ServoState::kEnabled}, 4 * n + 2, 4 * n + 4).empty());
  }
}

}  // namespace
}  // namespace teletact::client
