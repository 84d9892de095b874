// One who looks on, on a clock of the test's: the newest, at its rate, with a credit of one.
#include "service/touch_plane/observer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>
#include <variant>

#include "service/scene/errors.h"
#include "service/touch_plane/touch_stream.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

using std::chrono::milliseconds;

class LookingOn : public testing::Test {
 protected:
  using Clock = Observer::Clock;
  // Answers one pose of the hand.
  void touch(double y_m) {
    stream.bring({++sequence, sequence - 1, {0.03, y_m, 0}, {}});
    while (true) {
      const TouchStream::Said said = stream.turn();
      stream.written();
      if (std::holds_alternative<TouchStream::Answered>(said)) return;
    }
  }
  // At `at` on: what is told, acknowledged at once.
  static std::optional<Observer::State> told(Observer& observer, Clock::time_point at, bool more = false) {
    auto state = observer.due(at, true, more);
    if (state) observer.acknowledge(state->number);
    return state;
  }
  const std::shared_ptr<Scene> scene = given_scene(30, 10);
  const CurrentDevice no_device{nullptr};
  TouchStream stream{scene, {"hand", 0, 1e-9, {}}, no_device};
  const Clock::time_point begin = Clock::now();
  std::uint64_t sequence = 0;
};

TEST_F(LookingOn, NobodyIsToldWhereNobodyLooks) {
  EXPECT_FALSE(scene->observers()->any());
  {
    Observer observer(scene, {.answers = true});
    EXPECT_TRUE(scene->observers()->any());
  }
  EXPECT_FALSE(scene->observers()->any());
}

TEST_F(LookingOn, NewestIsToldAfterTheLastWasAcknowledged) {
  Observer observer(scene, {.answers = true}, 10);
  const auto first = observer.due(begin, true, false);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->number, 1u);
  EXPECT_FALSE(first->news.touch);
  touch(0.001);
  EXPECT_FALSE(observer.due(begin + milliseconds(200), true, false)) << "not acknowledged";
  observer.acknowledge(1);
  EXPECT_FALSE(observer.due(begin + milliseconds(50), true, false)) << "too soon";
  EXPECT_FALSE(observer.due(begin + milliseconds(200), false, false)) << "the last is being sent";
  const auto second = told(observer, begin + milliseconds(200));
  ASSERT_TRUE(second && second->news.touch);
  EXPECT_EQ(second->number, 2u);
  EXPECT_EQ(second->news.touch->answered.asked.pose.sequence, 1u);
  EXPECT_TRUE(second->news.touch->answered.answer.contact.pressure.empty());
  EXPECT_EQ(second->finger.session_id, "hand");
  EXPECT_FALSE(told(observer, begin + milliseconds(310))) << "nothing is new";
  EXPECT_TRUE(told(observer, begin + milliseconds(410), true)) << "a map waits";
  EXPECT_TRUE(told(observer, begin + milliseconds(410) + Observer::kHeartbeat)) << "a heartbeat";
}

TEST_F(LookingOn, TheSurfaceIsToldInContactAndOnceAtRest) {
  Observer observer(scene, {.surface = true});
  told(observer, begin);
  touch(0.002);  // the work beside touch is done in place here
  const auto pressed = told(observer, begin + milliseconds(100));
  ASSERT_TRUE(pressed && pressed->news.surface);
  EXPECT_FALSE(pressed->news.touch) << "not asked for";
  const DeformedLayer& layer = pressed->news.surface->layer;
  ASSERT_FALSE(layer.x_m.empty());
  EXPECT_EQ(layer.displacement_m.size(), layer.x_m.size() * layer.z_m.size());
  EXPECT_NEAR(*std::ranges::max_element(layer.displacement_m), 0.002, 0.0003) << "as deep as the tip";
  touch(-0.002);  // at once: no surface in contact would be made yet
  const auto lifted = told(observer, begin + milliseconds(200));
  ASSERT_TRUE(lifted && lifted->news.surface);
  EXPECT_TRUE(lifted->news.surface->layer.x_m.empty());
  touch(-0.003);
  EXPECT_FALSE(told(observer, begin + milliseconds(300))) << "it still rests";
}

TEST_F(LookingOn, ALayerWhoseStreamEndsInContactIsToldAtRest) {
  Observer observer(scene, {.surface = true});
  told(observer, begin);
  {
    TouchStream another{scene, {"another", 0, 1e-9, {}}, no_device};
    stream.hand_over("another");
    another.bring({1, 0, {0.03, 0.002, 0}, {}});
    for (bool answered = false; !answered; another.written())
      answered = std::holds_alternative<TouchStream::Answered>(another.turn());
    const auto pressed = told(observer, begin + milliseconds(100));
    ASSERT_TRUE(pressed && pressed->news.surface);
    EXPECT_FALSE(pressed->news.surface->layer.x_m.empty());
  }
  const auto ended = told(observer, begin + milliseconds(200));
  ASSERT_TRUE(ended && ended->news.surface);
  EXPECT_TRUE(ended->news.surface->layer.x_m.empty());
}

// However seldom it is told, what it is told is the newest.
TEST_F(LookingOn, AnAnswerIsTheNewestAtAnyRate) {
  Observer observer(scene, {.answers = true}, 0.5);
  told(observer, begin);
  for (const double y_m : {0.001, 0.002, -0.001}) touch(y_m);
  const auto state = told(observer, begin + milliseconds(2001));
  ASSERT_TRUE(state && state->news.touch);
  EXPECT_EQ(state->news.touch->answered.asked.pose.sequence, sequence);
}

TEST_F(LookingOn, WhoAcknowledgesNothingIsEndedAndWhoLiesToo) {
  Observer observer(scene, {});
  EXPECT_THROW(observer.acknowledge(1), std::invalid_argument) << "of what was not told";
  ASSERT_TRUE(observer.due(begin, true, false));
  const auto patience = std::chrono::duration_cast<Clock::duration>(
      std::chrono::duration<double>(scene->limits().acknowledge_s));
  EXPECT_FALSE(observer.due(begin + patience - milliseconds(1), true, false));
  EXPECT_THROW(observer.due(begin + patience + milliseconds(1), true, false), Error);
}

TEST_F(LookingOn, OptionsThatCannotBeMetAreNamed) {
  const auto refused = [&](const Observers::Options& options, double max_rate_hz, const char* field) {
    try {
      Observer observer(scene, options, max_rate_hz);
      return testing::AssertionFailure() << "taken";
    } catch (const std::invalid_argument& error) {
      return std::string(error.what()).starts_with(field) ? testing::AssertionSuccess()
                                                          : testing::AssertionFailure() << error.what();
    }
  };
  for (const double rate_hz : {-1.0, 0.05, 60.5, std::nan("")})
    EXPECT_TRUE(refused({}, rate_hz, "open.max_rate_hz")) << rate_hz;
  EXPECT_TRUE(refused({.session_id = std::string(65, 'x')}, 0, "open.session_id"));
  EXPECT_FALSE(scene->observers()->any()) << "one that is refused never looked";
}

}  // namespace
}  // namespace teletact::service
