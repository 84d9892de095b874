#include "client/watch/player.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <thread>

#include "client/link/recording.h"
#include "client/servo/states.h"
#include "tests/watch/web_peer.h"

namespace teletact::client {
namespace {

using namespace nlohmann::literals;

constexpr auto kTrace = static_cast<std::uint32_t>(Channel::kTrace);
constexpr auto kTimeline = static_cast<std::uint32_t>(Channel::kTimeline);
constexpr auto kStatus = static_cast<std::uint32_t>(Channel::kStatus);

// Twenty seconds, PAUSED from 5 to 8 s. The last tick is DISABLED, and alone without a force.
class PlayerTest : public ::testing::Test {
 protected:
  PlayerTest() : path_("/tmp/teletact-played-" + std::to_string(::getpid())) {
    v1::RecordHeader header;
    header.set_kind("touch");
    header.set_scene_id("s");
    RecordWriter writer(path_, header);
    for (int n = 0; n < 20'000; ++n) {
      v1::RecordEntry entry;
      entry.set_monotonic_ns(7'000'000'000 + n * std::int64_t{1'000'000});
      const bool paused = n >= 5000 && n < 8000;
      const bool last = n == 19'999;
      entry.mutable_servo()->set_state(static_cast<std::uint32_t>(last     ? ServoState::kDisabled
                                                                  : paused ? ServoState::kPaused
                                                                           : ServoState::kEnabled));
      for (const double force_n : {0.0, last ? 0.0 : -1.0, 0.0}) entry.mutable_servo()->add_force_n(force_n);
      entry.mutable_servo()->set_reason(
          static_cast<std::uint32_t>(paused ? StateReason::kSilence : StateReason::kResumed));
      writer.append_waiting(std::move(entry));
    }
    writer.close();
  }
  ~PlayerTest() override { std::remove(path_.c_str()); }

  std::map<std::uint32_t, test::WebSlot> news() {
    std::string whole = frame(1, view_.news(seen_));
    auto slots = test::decoded(whole).slots;
    if (slots.contains(kStatus)) {
      playing_ = slots.at(kStatus).json.value("playing", nlohmann::json());
      at_s_ = slots.at(kStatus).json.value("/playing/at_s"_json_pointer, at_s_);
    }
    return slots;
  }
  // Seconds since the beginning that the newest row shows.
  double shown_s() {
    const auto slots = news();
    if (!slots.contains(kTrace)) return shown_s_;
    const auto& slot = slots.at(kTrace);
    const std::size_t rows = slot.json["arrays"][0]["shape"][0];
    if (rows == 0) return shown_s_ = 0;
    std::memcpy(row_.data(), slot.data.data() + (rows - 1) * sizeof(row_), sizeof(row_));
    return shown_s_ = row_[0] + slot.json["begin_s"].get<double>() - 7;
  }
  bool comes(double from_s, double to_s) {
    for (int n = 0; n < 1000; ++n) {
      if (const double now_s = shown_s(); now_s >= from_s && now_s <= to_s) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return false;
  }

  std::string path_;
  View view_;
  View::Seen seen_;
  Trace::Row row_{};               // the newest
  double shown_s_ = 0, at_s_ = 0;  // of it, and as the status says
  nlohmann::json playing_;         // what the status says
};

TEST_F(PlayerTest, KnowsItsStatesAndReasonsFromTheBeginning) {
  const Player player({path_}, view_);
  const nlohmann::json timeline = news().at(kTimeline).json;
  EXPECT_NEAR(timeline["length_s"].get<double>(), 20, 0.01);
  ASSERT_EQ(timeline["spells"].size(), 4u);
  EXPECT_EQ(timeline["spells"][1]["state"], "PAUSED");
  EXPECT_NEAR(timeline["spells"][1]["at_s"].get<double>(), 5, 0.01);
  EXPECT_EQ(timeline["spells"][1]["reason"], describe(StateReason::kSilence));
}

TEST_F(PlayerTest, PlaysAtAnySpeedFromAnyPlaceBackwardsToo) {
  Player player({path_}, view_);
  player.obey({{"speed", 100}});
  EXPECT_TRUE(comes(10, 20.1));
  player.obey({{"speed", 0}, {"seek_s", 3}});
  EXPECT_TRUE(comes(2.9, 3.01)) << shown_s_;
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_TRUE(comes(2.9, 3.01)) << "it stands still";
  EXPECT_EQ(playing_["speed"], 0) << "not the slowest that it can play at";
  player.obey({{"seek_s", 12.5}});
  EXPECT_TRUE(comes(12.4, 12.51)) << shown_s_;
  player.obey({{"seek_s", "x"}, {"speed", nlohmann::json()}});
  player.obey({{"seek_s", 1e300}});
  EXPECT_TRUE(comes(19.9, 20.01)) << shown_s_;
}

// What the status says: where it plays, and what became of it.
TEST_F(PlayerTest, StandsAtTheEndUntilItIsToldOtherwise) {
  Player player({path_}, view_);
  player.obey({{"speed", 100}});
  EXPECT_TRUE(comes(19.9, 20.01)) << shown_s_;
  for (int n = 0; n < 1000 && at_s_ < 20; ++n) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    news();
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  news();
  EXPECT_EQ(at_s_, 20);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_FALSE(news().contains(kStatus)) << "nothing is new any more";
  player.obey({{"seek_s", 3}, {"speed", 0}});
  EXPECT_TRUE(comes(2.9, 3.01)) << shown_s_;
}

TEST_F(PlayerTest, BeginsWhenSomebodyLooks) {
  Player player({path_}, view_);
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_EQ(shown_s(), 0);
  EXPECT_EQ(at_s_, 0);
  EXPECT_EQ(playing_["speed"], 1) << "it plays once somebody does";
  player.begin();
  player.begin();
  EXPECT_TRUE(comes(0.1, 5)) << shown_s_;
}

// Nothing comes behind the last ticks that would push them out.
TEST_F(PlayerTest, AtTheEndItsOwnLastTickIsShownAndPlayBeginsAgain) {
  Player player({path_}, view_);
  player.obey({{"speed", 100}});
  EXPECT_TRUE(comes(19.98, 20.01)) << shown_s_;
  for (int n = 0; n < 1000 && !playing_.value("over", false); ++n) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    shown_s();
  }
  const auto column = [&](const std::string& name) {
    const auto found = std::ranges::find(Trace::columns(), name);
    return row_.at(static_cast<std::size_t>(found - Trace::columns().begin()));
  };
  EXPECT_EQ(static_cast<unsigned>(column("flags")) & 3U, static_cast<unsigned>(ServoState::kDisabled));
  EXPECT_EQ(column("force_y_n"), 0);
  seen_ = {};  // who comes now
  news();
  EXPECT_EQ(playing_["over"], true);
  EXPECT_NEAR(playing_["length_s"].get<double>(), 20, 0.01);
  player.obey({{"speed", 1}, {"seek_s", 0}});
  EXPECT_TRUE(comes(0.01, 5)) << shown_s_;
  EXPECT_EQ(playing_["over"], false);
}

TEST_F(PlayerTest, SaysThatARecordingHasGoneAndPlaysItOnceItIsBack) {
  Player player({path_}, view_);
  const std::string aside = path_ + "-aside";
  ASSERT_EQ(std::rename(path_.c_str(), aside.c_str()), 0);
  player.obey({{"seek_s", 3}, {"speed", 0}});
  std::string said;
  for (int n = 0; n < 1000 && said.empty(); ++n) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    const auto slots = news();
    if (!slots.contains(kStatus)) continue;
    if (const auto& session = slots.at(kStatus).json["session"]; session.is_string()) said = session;
  }
  EXPECT_NE(said.find("broken off"), std::string::npos) << said;
  for (int n = 0; n < 1000 && !playing_.value("over", false); ++n) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    news();
  }
  EXPECT_EQ(playing_["over"], true) << "it plays no more";
  ASSERT_EQ(std::rename(aside.c_str(), path_.c_str()), 0);
  player.obey({{"seek_s", 4}});
  EXPECT_TRUE(comes(3.9, 4.01)) << shown_s_;
}

TEST_F(PlayerTest, KnowsWhetherThereAreMaps) {
  EXPECT_FALSE(Player({path_}, view_).has_maps());
  const std::string acquired = path_ + "-acquired";
  v1::RecordHeader header;
  header.set_kind("acquire");
  RecordWriter writer(acquired, header);
  v1::RecordEntry entry;
  entry.set_monotonic_ns(8'000'000'000);
  entry.mutable_scene()->mutable_youngs_modulus();
  writer.append_waiting(std::move(entry));
  writer.close();
  EXPECT_TRUE(Player({path_, acquired}, view_).has_maps());
  std::remove(acquired.c_str());
}

TEST_F(PlayerTest, SaysWhatIsNoRecordingOfATouch) {
  EXPECT_THROW(Player({"/nonexistent"}, view_), std::runtime_error);
  { RecordWriter(path_, {}).close(); }
  EXPECT_THROW(Player({path_}, view_), std::runtime_error);
}

}  // namespace
}  // namespace teletact::client
