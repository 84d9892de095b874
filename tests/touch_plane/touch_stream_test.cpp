// A stream of touches without a network: the newest pose is answered, under credit.
#include "service/touch_plane/touch_stream.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <thread>

#include "service/plan/choices.h"
#include "service/scene/errors.h"
#include "service/touch_plane/finger_watch.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

class Stream : public testing::Test {
 protected:
  // The pose that is answered next; none when it takes longer than that of a stream that may answer.
  std::optional<TouchStream::Arrived> next() {
    std::atomic<bool> stop{false};
    std::thread later([&] {
      for (int k = 0; k < 100 && !stop; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      stop = true;
      stream.wake();
    });
    auto pose = stream.next([] { return true; }, [&] { return stop.load(); });
    stop = true;
    later.join();
    return pose;
  }
  static FingerPose pose(std::uint64_t sequence, std::uint64_t acknowledged, double y_m = 0.002) {
    return {sequence, acknowledged, {0.03, y_m, 0}, {}};
  }
  const std::shared_ptr<Scene> scene = std::make_shared<Scene>(
      "s", tissue(0.06, 0.02),
      ExplicitModulus{uniform_coordinates(0, 0.06, 30), uniform_coordinates(0, 0.02, 10),
                      std::vector<double>(300, 1e4)},
      versions());
  const CurrentDevice no_device{nullptr};
  TouchStream stream{scene, {"hand", 0, 0, {}}, no_device};
};

TEST_F(Stream, AnswersTheNewestPoseOnceTheLastAnswerIsAcknowledged) {
  stream.bring(pose(1, 0));
  auto asked = next();
  ASSERT_TRUE(asked);
  const TouchStream::Answered first = stream.answer(*asked);
  EXPECT_EQ(first.number, 1U);
  EXPECT_EQ(first.answer.status, TouchStatus::kOk);
  EXPECT_LT(first.answer.contact.force_n[1], 0);
  EXPECT_TRUE(first.steering.steers);
  stream.bring(pose(2, 0));
  EXPECT_FALSE(next()) << "beyond its credit";
  stream.bring(pose(3, 1, 0.003));
  asked = next();
  ASSERT_TRUE(asked);
  EXPECT_EQ(asked->pose.sequence, 3U);
  EXPECT_LT(stream.answer(*asked).answer.contact.force_n[1], first.answer.contact.force_n[1]);
  EXPECT_EQ(stream.counts().replaced, 1U);
}

// Who feels a law must not be told of a version that it has none of.
TEST(StreamWithLaws, AnswersFromTheVersionBeforeUntilTheNewLawIsTold) {
  const auto scene = std::make_shared<Scene>("s", tissue(0.06, 0.02), versions());
  const auto publish = [&](double pa) {
    const auto never = [] { return false; };
    return scene->publish(window_of(homogeneous(pa), 0, 0.06, 0.02), never).version;
  };
  const std::uint64_t first = publish(1e4);
  const CurrentDevice no_device{nullptr};
  TouchStream stream(scene, {"hand", 8, 0, {}, true}, no_device);
  std::uint64_t sequence = 0;
  const auto answered_version = [&] {
    stream.bring({++sequence, sequence - 1, {0.03, 0.002, 0}, {}});
    const auto asked = stream.next([] { return true; }, [] { return false; });
    return asked ? stream.answer(*asked).answer.model_version : 0;
  };
  EXPECT_EQ(answered_version(), first);
  ASSERT_TRUE(stream.next_law());
  ASSERT_TRUE(stream.next_law());
  EXPECT_FALSE(stream.next_law()) << "two between answers";
  const std::uint64_t second = publish(2e4);
  EXPECT_EQ(answered_version(), first) << "nothing is told of the newer yet";
  const auto piece = stream.next_law();
  ASSERT_TRUE(piece);
  EXPECT_EQ(piece->version, second);
  EXPECT_EQ(answered_version(), second);
  // A law that never comes is not waited for, however often there is a newer version.
  publish(3e4);
  EXPECT_EQ(answered_version(), second);
  std::this_thread::sleep_for(choices::kLawExpected);
  const std::uint64_t fourth = publish(4e4);
  EXPECT_EQ(answered_version(), fourth);
}

TEST_F(Stream, RefusesPosesOutOfOrderAndWishesThatCannotBeMet) {
  stream.bring(pose(2, 0));
  EXPECT_THROW(stream.bring(pose(2, 0)), std::invalid_argument);
  EXPECT_THROW(stream.bring(pose(3, 1)), std::invalid_argument) << "nothing was answered";
  const Limits limits;
  EXPECT_THROW(TouchStream(scene, {"", TouchStream::kMostCredit + 1, 0, {}}, no_device),
               std::invalid_argument);
  EXPECT_THROW(TouchStream(scene, {"", 0, 2 * limits.most_touch_period_s, {}}, no_device),
               std::invalid_argument);
  EXPECT_THROW(
      TouchStream(scene, {std::string(TouchStream::kMostSessionIdBytes + 1, 'n'), 0, 0, {}}, no_device),
      std::invalid_argument);
}

TEST_F(Stream, IsToldToWhoWatchesOneStateAfterTheOther) {
  FingerWatch watch(scene);
  const auto now = FingerWatch::Clock::now();
  stream.bring(pose(1, 0));
  const auto state = watch.due(now, true);
  ASSERT_TRUE(state);
  EXPECT_EQ(state->number, 1U);
  EXPECT_EQ(state->finger.session_id, "hand");
  EXPECT_EQ(state->finger.position_m[0], 0.03);
  stream.bring(pose(2, 0));
  EXPECT_FALSE(watch.due(now + std::chrono::seconds(1), true)) << "the first is not acknowledged";
  EXPECT_THROW(watch.acknowledge(2), std::invalid_argument);
  watch.acknowledge(1);
  EXPECT_TRUE(watch.due(now + std::chrono::seconds(1), true));
}

}  // namespace
}  // namespace teletact::service
