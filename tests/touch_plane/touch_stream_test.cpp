// A stream of touches without a network: the newest pose is answered, under credit.
#include "service/touch_plane/touch_stream.h"

#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <functional>
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
  const std::shared_ptr<Scene> scene = given_scene(30, 10);
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

// On a narrow link an answer takes as long as the columns around the finger.
TEST(StreamWithLaws, WhatIsNearTheFingerGoesBeforeItsAnswer) {
  const auto scene = std::make_shared<Scene>("s", tissue(0.06, 0.02), versions());
  const auto never = [] { return false; };
  scene->publish(window_of(homogeneous(1e4), 0, 0.06, 0.02), never);
  const CurrentDevice no_device{nullptr};
  TouchStream stream(scene, {"hand", 8, 0, {}, true}, no_device);
  EXPECT_FALSE(stream.next_law()) << "where is the finger?";
  const double x_m = 0.03;
  stream.bring({1, 0, {x_m, 0.002, 0}, {}});
  const auto asked = stream.next([] { return true; }, never);
  ASSERT_TRUE(asked);
  double begin_m = x_m, end_m = x_m;
  while (const auto piece = stream.law_before(*asked, never)) begin_m = piece->begin_m, end_m = piece->end_m;
  EXPECT_LE(begin_m, x_m - TouchStream::kLawNearM + choices::kLawPitch);
  EXPECT_GE(end_m, x_m + TouchStream::kLawNearM - choices::kLawPitch);
  stream.answer(*asked);
  const auto far = stream.next_law();
  ASSERT_TRUE(far);
  for (const LawColumn& column : far->columns) EXPECT_GT(std::abs(column.x_m - x_m), TouchStream::kLawNearM);
  stream.bring({2, 1, {std::nan(""), 0.002, 0}, {}});
  const auto nowhere = stream.next([] { return true; }, never);
  ASSERT_TRUE(nowhere);
  EXPECT_FALSE(stream.law_before(*nowhere, never));
}

// Nothing is felt before the first answer. Later ones must not wait for what is being sampled.
TEST(StreamWithLaws, OnlyTheFirstAnswerWaitsForALawThatIsBeingSampled) {
  const auto scene = std::make_shared<Scene>("s", tissue(0.06, 0.02), versions());
  std::deque<std::function<void()>> jobs;
  scene->set_touch_work(
      [&jobs](const std::string&, std::function<void()> job) { jobs.push_back(std::move(job)); });
  const auto never = [] { return false; };
  const auto publish = [&](double pa) {
    scene->publish(window_of(homogeneous(pa), 0, 0.06, 0.02), never);
    scene->snapshot()->windows[0]->model->layer({}, {}, {});  // ready to be touched
  };
  publish(1e4);
  const CurrentDevice no_device{nullptr};
  TouchStream stream(scene, {"hand", 8, 0, {}, true}, no_device);
  unsigned looks = 0;
  const auto work = [&] {  // looked at by who waits
    ++looks;
    for (; !jobs.empty(); jobs.pop_front()) jobs.front()();
    return false;
  };
  const auto brought = [&](std::uint64_t sequence) {
    const FingerPose pose{sequence, sequence - 1, {0.03, 0.002, 0}, {}};
    stream.bring(pose);
    EXPECT_TRUE(stream.next([] { return true; }, never));
    return TouchStream::Arrived{pose, TouchStream::Clock::now() + std::chrono::hours(1)};
  };
  const auto first = brought(1);
  EXPECT_TRUE(stream.law_before(first, work));
  EXPECT_GT(looks, 0U);
  EXPECT_EQ(stream.answer(first).answer.status, TouchStatus::kOk);
  publish(2e4);
  looks = 0;
  const auto second = brought(2);
  EXPECT_FALSE(stream.law_before(second, work));
  EXPECT_EQ(looks, 0U);
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

TEST_F(Stream, ThatIsRefusedNeverWasAtTheScene) {
  stream.leave();
  ASSERT_FALSE(scene->finger().now().present);
  TouchWishes wishes{"ghost", 0, 0, {}};
  wishes.tactile = TaxelGrid{.along_x = TactileOutbox::kMostTaxels + 1};
  EXPECT_THROW(TouchStream(scene, std::move(wishes), no_device), std::invalid_argument);
  EXPECT_FALSE(scene->finger().now().present);
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
