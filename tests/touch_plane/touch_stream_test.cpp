// A stream of touches without a network: the newest pose is answered, under credit.
#include "service/touch_plane/touch_stream.h"

#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <functional>
#include <optional>
#include <stdexcept>
#include <thread>
#include <variant>
#include <vector>

#include "service/base/choices.h"
#include "service/scene/errors.h"
#include "service/touch_plane/observer.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

// The next answer, once it is due, each thing that goes before it given to `before`; none where none is due.
std::optional<TouchStream::Answered> next_answer(
    TouchStream& stream, const std::function<void(const LawPiece&)>& before = [](const LawPiece&) {}) {
  while (true) {
    const auto due = stream.due();
    if (due == TouchStream::Clock::time_point::max()) return std::nullopt;
    std::this_thread::sleep_until(due);
    const TouchStream::Said said = stream.turn();
    stream.written();
    if (const auto* answered = std::get_if<TouchStream::Answered>(&said)) return *answered;
    if (const auto* piece = std::get_if<LawPiece>(&said)) before(*piece);
  }
}

// What is told of a law before the next pose comes, at once.
std::optional<LawPiece> next_law(TouchStream& stream) {
  const TouchStream::Said said = stream.turn();
  stream.written();
  const auto* piece = std::get_if<LawPiece>(&said);
  return piece ? std::make_optional(*piece) : std::nullopt;
}

class Stream : public testing::Test {
 protected:
  std::optional<TouchStream::Answered> next() { return next_answer(stream); }
  static FingerPose pose(std::uint64_t sequence, std::uint64_t acknowledged, double y_m = 0.002) {
    return {sequence, acknowledged, {0.03, y_m, 0}, {}};
  }
  const std::shared_ptr<Scene> scene = given_scene(30, 10);
  const CurrentDevice no_device{nullptr};
  TouchStream stream{scene, {"hand", 0, 0, {}}, no_device};
};

TEST_F(Stream, AnswersTheNewestPoseOnceTheLastAnswerIsAcknowledged) {
  stream.bring(pose(1, 0));
  const auto first = next();
  ASSERT_TRUE(first);
  EXPECT_EQ(first->number, 1U);
  EXPECT_EQ(first->answer.status, TouchStatus::kOk);
  EXPECT_LT(first->answer.contact.force_n[1], 0);
  EXPECT_TRUE(first->steering.steers);
  EXPECT_EQ(first->period, stream.period());
  stream.bring(pose(2, 0));
  EXPECT_FALSE(next()) << "beyond its credit";
  stream.bring(pose(3, 1, 0.003));
  const auto second = next();
  ASSERT_TRUE(second);
  EXPECT_EQ(second->asked.pose.sequence, 3U);
  EXPECT_LT(second->answer.contact.force_n[1], first->answer.contact.force_n[1]);
  EXPECT_EQ(stream.counts().replaced, 1U);
}

// A hand that feels laws of a scene, all of whose work beside touch waits until it is let.
class StreamWithLaws : public testing::Test {
 protected:
  static constexpr double kXM = 0.03;
  StreamWithLaws() {
    scene->set_touch_work(
        [this](const std::string&, std::function<void()> job) { jobs.push_back(std::move(job)); });
  }
  std::uint64_t publish(double pa) {
    const auto published = scene->publish(window_of(homogeneous(pa), 0, 0.06, 0.02));
    scene->snapshot()->windows[0]->model->layer({}, {}, {});  // ready to be touched
    return published.version;
  }
  void work() {
    for (; !jobs.empty(); jobs.pop_front()) jobs.front()();
  }
  // The version of the answer to the next pose, and what went before it.
  std::uint64_t answered_version(double x_m = kXM) {
    before.clear();
    stream.bring({++sequence, stream.counts().answers, {x_m, 0.002, 0}, {}, 3, 0, 0, pieces});
    const auto answered = next_answer(stream, [&](const LawPiece& piece) { keep(piece); });
    EXPECT_TRUE(answered);
    return answered ? answered->answer.model_version : 0;
  }
  void keep(const LawPiece& piece) {
    before.push_back(piece);
    pieces = piece.number;
  }
  const std::shared_ptr<Scene> scene = std::make_shared<Scene>("s", tissue(0.06, 0.02), versions());
  std::deque<std::function<void()>> jobs;
  const CurrentDevice no_device{nullptr};
  std::uint64_t sequence = 0, pieces = 0;
  std::vector<LawPiece> before;
  TouchStream stream{scene, {"hand", 8, 0, {}, true}, no_device};
};

// Who feels a law must not be told of a version that it has none of.
TEST_F(StreamWithLaws, AnswersByTheOldVersionUntilTheLawIsTold) {
  const std::uint64_t first = publish(1e4);
  EXPECT_EQ(answered_version(), first);
  work();
  EXPECT_EQ(answered_version(), first);
  ASSERT_FALSE(before.empty());
  const std::uint64_t second = publish(2e4);
  EXPECT_EQ(answered_version(), first) << "nothing is told of the newer yet";
  work();
  EXPECT_EQ(answered_version(), second);
  ASSERT_FALSE(before.empty());
  EXPECT_EQ(before.back().version, second);
  // A law that never comes is not waited for, however often there is a newer version.
  publish(3e4);
  EXPECT_EQ(answered_version(), second);
  std::this_thread::sleep_for(choices::kLawExpected);
  const std::uint64_t fourth = publish(4e4);
  EXPECT_EQ(answered_version(), fourth);
}

// On a narrow link an answer takes as long as the columns around the finger.
TEST_F(StreamWithLaws, NearPiecesGoBeforeTheAnswer) {
  publish(1e4);
  EXPECT_TRUE(std::holds_alternative<TouchStream::Opened>(stream.turn()));
  stream.written();
  EXPECT_FALSE(next_law(stream)) << "where is the finger?";
  answered_version();
  work();
  answered_version();
  double begin_m = kXM, end_m = kXM;
  for (const LawPiece& piece : before) begin_m = piece.begin_m, end_m = piece.end_m;
  EXPECT_LE(begin_m, kXM - TouchStream::kLawNearM + choices::kLawPitch);
  EXPECT_GE(end_m, kXM + TouchStream::kLawNearM - choices::kLawPitch);
  for (int k = 0; k < 2; ++k) {
    const auto far = next_law(stream);
    ASSERT_TRUE(far);
    for (const LawColumn& column : far->columns)
      EXPECT_GT(std::abs(column.x_m - kXM), TouchStream::kLawNearM);
  }
  EXPECT_FALSE(next_law(stream)) << "two between answers";
  stream.bring({++sequence, stream.counts().answers, {std::nan(""), 0.002, 0}, {}});
  const auto near_nowhere = [] { FAIL() << "nothing is near a finger that is nowhere"; };
  EXPECT_THROW(next_answer(stream, [&](const LawPiece&) { near_nowhere(); }), std::invalid_argument);
}

// Nothing is felt before the first answer. Later ones must not wait for what is being sampled.
TEST_F(StreamWithLaws, OnlyTheFirstAnswerWaitsForSampling) {
  publish(1e4);
  stream.bring({++sequence, 0, {kXM, 0.002, 0}, {}});
  EXPECT_TRUE(std::holds_alternative<TouchStream::Opened>(stream.turn()));
  stream.written();
  EXPECT_TRUE(std::holds_alternative<std::monostate>(stream.turn())) << "it is looked for again";
  work();
  const auto first = next_answer(stream, [&](const LawPiece& piece) { keep(piece); });
  ASSERT_TRUE(first);
  EXPECT_EQ(first->answer.status, TouchStatus::kOk);
  publish(2e4);
  std::this_thread::sleep_for(first->period);
  while (next_law(stream)) {
  }
  stream.bring({++sequence, 1, {kXM, 0.002, 0}, {}});
  EXPECT_TRUE(std::holds_alternative<TouchStream::Answered>(stream.turn()));
}

TEST_F(Stream, RefusesPosesOutOfOrderAndWishesThatCannotBeMet) {
  stream.bring(pose(2, 0));
  EXPECT_THROW(stream.bring(pose(2, 0)), std::invalid_argument);
  EXPECT_THROW(stream.bring(pose(3, 1)), std::invalid_argument) << "nothing was answered";
  const Limits limits;
  EXPECT_THROW(TouchStream(scene, {"", TouchStream::kMaxCredit + 1, 0, {}}, no_device),
               std::invalid_argument);
  EXPECT_THROW(TouchStream(scene, {"", 0, 2 * limits.max_touch_period_s, {}}, no_device),
               std::invalid_argument);
  EXPECT_THROW(
      TouchStream(scene, {std::string(TouchStream::kMaxSessionIdBytes + 1, 'n'), 0, 0, {}}, no_device),
      std::invalid_argument);
}

TEST_F(Stream, ThatIsRefusedNeverWasAtTheScene) {
  stream.end();
  EXPECT_TRUE(std::holds_alternative<TouchStream::Left>(stream.turn()));
  ASSERT_FALSE(scene->finger().now().present);
  TouchStreamOptions wishes{"ghost", 0, 0, {}};
  wishes.tactile = TaxelGrid{.along_x = TactileOutbox::kMaxTaxels + 1};
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
