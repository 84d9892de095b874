// Corrections beside those who answer: nobody waits for one, of each finger the newest wish is met where the
// finger will be, what fails is told, and the end comes after the one that is being made.
#include "service/contact/corrector.h"

#include <gtest/gtest.h>

#include <cmath>
#include <future>
#include <stdexcept>
#include <vector>

#include "service/contact/solid_contact.h"
#include "tests/solver/block_stencil.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

const auto kLong = std::chrono::seconds(20);
TouchPose at(double x_m, double z_m = 0) {
  return {{x_m, 0.002, z_m}};
}

// Corrections that each wait to be let go.
struct Held {
  std::mutex mutex;
  std::condition_variable changed;
  int begun = 0, allowed = 0;
  std::vector<Vector3> places;
  void operator()(const Fingertip&, const TouchPose& pose) {
    std::unique_lock lock(mutex);
    places.push_back(pose.position_m);
    ++begun;
    changed.notify_all();
    changed.wait(lock, [&] { return allowed >= begun; });
  }
  void allow(int more) {
    const std::lock_guard lock(mutex);
    allowed += more;
    changed.notify_all();
  }
  void wait_for(int count) {
    std::unique_lock lock(mutex);
    ASSERT_TRUE(changed.wait_for(lock, kLong, [&] { return begun >= count; }));
  }
};

TEST(Corrector, OfEachFingerTheNewestWishIsMetAndNobodyWaits) {
  Held held;
  Corrector corrector([&](const Fingertip& tip, const TouchPose& pose) { held(tip, pose); });
  corrector.ask({}, at(0));
  held.wait_for(1);
  for (int k = 1; k <= 100; ++k) {  // all while the first is held
    corrector.ask({}, at(0.0001 * k));
    corrector.ask({}, at(0.0001 * k, 0.05));
  }
  EXPECT_EQ(corrector.done(), 0u);
  EXPECT_FALSE(corrector.wait_for_more_than(0, Corrector::Clock::now()));
  held.allow(3);
  EXPECT_TRUE(corrector.wait_for_more_than(2, Corrector::Clock::now() + kLong));
  ASSERT_EQ(held.places.size(), 3u) << "one for each finger that waited";
  EXPECT_NEAR(held.places[1][0], 0.01, 1e-12);
  EXPECT_NEAR(held.places[2][0], 0.01, 1e-12);
  EXPECT_NE(held.places[1][2], held.places[2][2]);
}

TEST(Corrector, TooManyFingersLeaveOutTheOldest) {
  Held held;
  Corrector corrector([&](const Fingertip& tip, const TouchPose& pose) { held(tip, pose); });
  corrector.ask({}, at(0));
  held.wait_for(1);
  for (int k = 1; k <= 20; ++k) corrector.ask({}, at(0.02 * k));
  held.allow(100);
  EXPECT_TRUE(corrector.wait_for_more_than(Corrector::kMaxFingers, Corrector::Clock::now() + kLong));
  ASSERT_EQ(held.places.size(), 1 + Corrector::kMaxFingers);
  EXPECT_NEAR(held.places.back()[0], 0.4, 1e-12);
}

TEST(Corrector, AimsWhereTheFingerWillBe) {
  TouchPose still = at(0.03), ahead = at(0.03), turning = at(0.03);
  ahead.velocity_m_s = {0.12, 0, 0};
  EXPECT_EQ(moved_on(still, 1).position_m, still.position_m);
  EXPECT_NEAR(moved_on(ahead, 0.02).position_m[0], 0.03 + 0.0024, 1e-9);
  EXPECT_NEAR(moved_on(ahead, 10).position_m[0], 0.03 + 0.008, 1e-9) << "never far away";
  constexpr double kRadiusM = 0.005;
  turning.velocity_m_s = {0, 0, 0.12};
  turning.turn_rad_s = 0.12 / kRadiusM;
  const Vector3 on = moved_on(turning, 0.04).position_m;
  const double angle = turning.turn_rad_s * 0.04;
  EXPECT_NEAR(on[0], 0.03 - kRadiusM + kRadiusM * std::cos(angle), 1e-9) << "on the circle";
  EXPECT_NEAR(on[2], kRadiusM * std::sin(angle), 1e-9);
  Held held;
  held.allow(1);
  Corrector corrector([&](const Fingertip& tip, const TouchPose& pose) { held(tip, pose); });
  corrector.ask({}, ahead);  // it lasts 50 ms
  held.wait_for(1);
  EXPECT_TRUE(corrector.wait_for_more_than(0, Corrector::Clock::now() + kLong));
  EXPECT_NEAR(held.places[0][0], 0.03, 1e-12) << "how long one takes is not known yet";
  corrector.ask({}, ahead);
  held.wait_for(2);
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  held.allow(2);
  EXPECT_TRUE(corrector.wait_for_more_than(1, Corrector::Clock::now() + kLong));
  corrector.ask({}, ahead);
  held.wait_for(3);
  EXPECT_GT(held.places[2][0], 0.0305) << "ahead by what the last ones took";
}

TEST(Corrector, WhatFailsIsToldUntilOneGoesWell) {
  bool fails = true;
  Corrector corrector([&](const Fingertip&, const TouchPose&) {
    if (fails) throw std::domain_error("it broke down");
  });
  EXPECT_FALSE(corrector.failure());
  corrector.ask({}, at(0));
  ASSERT_TRUE(corrector.wait_for_more_than(0, Corrector::Clock::now() + kLong)) << "waiters are told";
  EXPECT_THROW(std::rethrow_exception(corrector.failure()), std::domain_error);
  fails = false;
  corrector.ask({}, at(0));
  ASSERT_TRUE(corrector.wait_for_more_than(1, Corrector::Clock::now() + kLong));
  EXPECT_FALSE(corrector.failure());
}

TEST(Corrector, EndsAfterTheOneThatIsBeingMadeAndBeginsNoOther) {
  Held held;
  auto corrector =
      std::make_unique<Corrector>([&](const Fingertip& tip, const TouchPose& pose) { held(tip, pose); });
  corrector->ask({}, at(0));
  held.wait_for(1);
  corrector->ask({}, at(0.05));
  auto ended = std::async(std::launch::async, [&] { corrector.reset(); });
  EXPECT_EQ(ended.wait_for(std::chrono::milliseconds(20)), std::future_status::timeout);
  held.allow(100);
  EXPECT_EQ(ended.wait_for(kLong), std::future_status::ready);
  EXPECT_EQ(held.begun, 1);
}

// Answers come from what is known while more is learned.
TEST(SolidContact, AnswersWhileItIsCorrected) {
  constexpr double kMiddle = 0.032;
  const SolidTissue tissue =
      solid({32, 32, 0.002, 0.002, graded_rows(0.040, 12, 1.06)}, 0.49, [](double x, double y, double z) {
        return std::hypot(x - kMiddle, y - 0.012, z - kMiddle) < 0.008 ? 1e5 : 1e4;
      });
  SolidContact<float> contact(test_device()->queue(), tissue);
  const auto pose = [](double x) { return Vector3{kMiddle + x, 0.002, kMiddle}; };
  std::atomic<bool> over{false};
  std::thread corrects([&] {
    for (double x = -0.012; x < 0.012; x += 0.002) contact.correct({}, pose(x));
    over = true;
  });
  std::size_t answers = 0, meanwhile = 0;
  while (!over) {
    const std::size_t before = contact.corrections();
    const ContactAnswer a = contact.answer({}, pose(0.001 * double(answers % 7)));
    EXPECT_LT(a.force_n[1], 0);
    meanwhile += contact.corrections() == before && !over;
    ++answers;
  }
  corrects.join();
  EXPECT_GT(meanwhile, contact.corrections()) << "an answer takes less than a correction";
  EXPECT_LE(contact.answer({}, pose(0)).solve.relative_error, 0.02) << "and knows what was learned";
}

}  // namespace
}  // namespace teletact::service
