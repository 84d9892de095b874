#include "client/link/touch_link.h"

#include <gtest/gtest.h>

#include "client/link/servo_messages.h"
#include "client/servo/tick_statistics.h"
#include "tests/link/operator.h"

namespace teletact::client {
namespace {

using test::answers_at_least;
using test::FakeAccount;
using test::FakePalpation;
using test::Operator;

TEST(TouchLink, CreditIsNeverExceededAndPosesAreInOrder) {
  FakePalpation service(test::socket_address("credit"));
  service.credit = 2;
  service.compute_s = 0.003;                  // slower than the poses come
  service.waits_for_acknowledgement = false;  // the client's own doing alone keeps the credit
  service.serve();
  Operator person(test::socket_address("credit"));
  ASSERT_TRUE(service.wait_until(answers_at_least(100)));
  const FakeAccount account = service.account();
  EXPECT_LE(account.max_unacknowledged, 2u);
  EXPECT_LE(account.max_unanswered, 2u);
  EXPECT_EQ(account.disorder, 0u);
  EXPECT_EQ(account.wrong_acknowledgements, 0u);
  EXPECT_EQ(account.streams, 1u);
}

TEST(TouchLink, AnswersCarryTheirOwnPose) {
  FakePalpation service(test::socket_address("pair"));
  service.serve();
  Operator person(test::socket_address("pair"));
  // What the service has sent may still be on its way.
  ASSERT_TRUE(test::within(5, [&] { return person.link->stats().distinct >= 19; }));
  ServoAnswer answer;
  ASSERT_TRUE(person.answers.take(answer));
  EXPECT_TRUE(answer.has_force);
  EXPECT_TRUE(answer.covered);
  const ForceSample truth = service.tissue.answer(answer.sample.position_m);
  EXPECT_LE((answer.sample.force_n - truth.force_n).norm(), 1e-12);
  EXPECT_LE((answer.sample.tangent_n_m - truth.tangent_n_m).norm(), 1e-9);
  EXPECT_GT(answer.received_ns * 1e-9, answer.sample.pose_time_s);
  EXPECT_EQ(person.link->stats().dropped, 0u);
}

TEST(TouchLink, MalformedTactileImageIsDroppedAlone) {
  FakePalpation service(test::socket_address("tactile"));
  service.tactile_pa = 700;
  service.serve();
  Operator person(test::socket_address("tactile"));
  ASSERT_TRUE(service.wait_until(answers_at_least(20)));
  ASSERT_TRUE(test::within(5, [&] { return person.link->stats().tactile_images > 0; }));
  const auto image = person.link->take_tactile();
  ASSERT_TRUE(image);
  EXPECT_EQ(image->pressure_pa, std::vector<float>{700});
  service.tactile_pa = -1;
  ASSERT_TRUE(test::within(5, [&] { return person.link->stats().tactile_dropped > 1; }));
  while (person.link->take_tactile()) {
  }
  const auto before = person.link->stats();
  ASSERT_TRUE(
      test::within(5, [&] { return person.link->stats().tactile_dropped > before.tactile_dropped + 5; }));
  EXPECT_FALSE(person.link->take_tactile());
  EXPECT_EQ(person.link->stats().tactile_images, before.tactile_images);
  EXPECT_EQ(person.link->stats().dropped, 0u) << "the force it came with counts";
}

TEST(TouchLink, AnAnswerToAnotherSessionsPoseIsNotFelt) {
  // GIVEN answers whose number is one of ours, THEN whose pose they answer decides.
  FakePalpation service(test::socket_address("foreign"));
  service.confuses = true;
  service.serve();
  Operator person(test::socket_address("foreign"));
  ASSERT_TRUE(service.wait_until(answers_at_least(2)));
  const auto dropped = [&] { return person.link->stats().dropped; };
  for (int k = 0; k < 1000 && dropped() < 2; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_GE(dropped(), 2u);
  ServoAnswer answer;
  EXPECT_FALSE(person.answers.take(answer));
}

TEST(TouchLink, AnswersFlowAgainAfterARestart) {
  FakePalpation service(test::socket_address("kill"));
  service.serve();
  Operator person(test::socket_address("kill"));
  ASSERT_TRUE(service.wait_until(answers_at_least(50)));
  service.kill();
  service.serve();
  const auto begin = std::chrono::steady_clock::now();
  ASSERT_TRUE(service.wait_until([](const FakeAccount& account) { return account.streams == 2; }, 5));
  const auto before = service.account().answers;
  ASSERT_TRUE(service.wait_until(answers_at_least(before + 20), 5));
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  EXPECT_LE(seconds, 2.0);
  std::printf("[ resume ] 20 answers %.3f s after the restart\n", seconds);
  EXPECT_TRUE(service.account().session_kept);
  EXPECT_EQ(service.account().disorder, 0u);  // sequences go on
  EXPECT_EQ(person.link->stats().instances, 2u);
  EXPECT_EQ(person.link->failure(), "");
}

// GIVEN a service that is started anew on another machine, and one farther away: THEN nothing of the old
// clock is left, though what was exchanged with it bounds the offset better.
TEST(TouchLink, TheClockOfARestartedServiceIsLearntAnew) {
  FakePalpation service(test::socket_address("clock"));
  service.clock_ahead = std::chrono::seconds(100);
  service.serve();
  Operator person(test::socket_address("clock"));
  ASSERT_TRUE(service.wait_until(answers_at_least(50)));
  service.kill();
  service.clock_ahead = std::chrono::seconds(-500);
  service.way_s = 0.02;
  service.serve();
  const auto before = service.account().answers;
  ASSERT_TRUE(service.wait_until(answers_at_least(before + 5), 10));
  person.link->stop();
  EXPECT_NEAR(person.link->stats().clock_offset_s, -500, 1);
}

TEST(TouchLink, ASceneNotYetReadAfterARestartIsRetried) {
  FakePalpation service(test::socket_address("state"));
  service.serve();
  Operator person(test::socket_address("state"));
  ASSERT_TRUE(service.wait_until(answers_at_least(10)));
  service.scene_known = false;
  service.kill();
  service.serve();
  std::this_thread::sleep_for(std::chrono::milliseconds(300));  // several refusals
  EXPECT_EQ(person.link->failure(), "");
  service.scene_known = true;
  ASSERT_TRUE(service.wait_until([](const FakeAccount& account) { return account.streams == 2; }, 5));
}

TEST(TouchLink, AnUnknownSceneIsAFailureSaidOnce) {
  FakePalpation service(test::socket_address("unknown"));
  service.scene_known = false;
  service.serve();
  Operator person(test::socket_address("unknown"));
  for (int n = 0; n < 500 && person.link->failure().empty(); ++n) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_EQ(person.link->failure(), "NOT_FOUND: scene is unknown");
}

TEST(TouchLink, AStreamThatSaysNothingIsDead) {
  // GIVEN a half-open link: it takes everything and answers nothing; THEN a new stream is opened.
  FakePalpation service(test::socket_address("half"));
  service.serve();
  Operator person(test::socket_address("half"), [](TouchLinkOptions& options) { options.dead_s = 0.2; });
  ASSERT_TRUE(service.wait_until(answers_at_least(10)));
  service.silent = true;
  ASSERT_TRUE(service.wait_until([](const FakeAccount& account) { return account.streams >= 2; }, 5));
  service.silent = false;
  const auto before = service.account().answers;
  EXPECT_TRUE(service.wait_until(answers_at_least(before + 10), 5));
}

TEST(TouchLink, KnowsTheServicesClockAndTheRoundTrip) {
  // GIVEN a service whose clock is 100 s ahead and that computes for 5 ms
  FakePalpation service(test::socket_address("clock"));
  service.clock_ahead = std::chrono::seconds(100);
  service.compute_s = 0.005;
  service.serve();
  Operator person(test::socket_address("clock"));
  ASSERT_TRUE(service.wait_until(answers_at_least(50)));
  ASSERT_TRUE(test::within(5, [&] { return person.link->stats().round_trips_s.count() >= 49; }));
  // THEN the offset is right within its own bound, and computing is no part of the round trip
  const TouchLinkStats stats = person.link->stats();
  EXPECT_LE(std::abs(stats.clock_offset_s - 100), stats.clock_offset_error_s);
  EXPECT_LE(stats.clock_offset_error_s, 0.02);
  ServoAnswer answer;
  ASSERT_TRUE(person.answers.take(answer));
  EXPECT_NEAR(answer.clock_offset_s, 100, 0.02);
  EXPECT_GT(answer.round_trip_s, 0);
  // ... and so the age of the modulus, stamped by that other clock, is known on ours.
  EXPECT_NEAR(1e-9 * static_cast<double>(answer.received_ns) - answer.modulus_time_s, 7, 0.05);
  EXPECT_LT(stats.round_trips_s.percentile(0.1), 0.005);
}

TEST(TouchLink, StopsAtOnceWithoutAService) {
  Operator person(test::socket_address("nobody"));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));  // amid its attempts
  EXPECT_EQ(person.link->stats().streams, 0u);
  const auto begin = std::chrono::steady_clock::now();
  person.link->stop();
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(2)) << "an attempt may take 3 s";
}

TEST(ServoMessages, AMalformedAnswerIsDropped) {
  v1::TouchAnswer answer;
  answer.set_status(v1::TOUCH_STATUS_OK);
  EXPECT_FALSE(to_servo_answer(answer, {}, 0.002, 1).has_value());
  answer.add_position_m(0);
  answer.add_position_m(0.004);
  EXPECT_FALSE(to_servo_answer(answer, {}, 0.002, 1).has_value());  // no force
  answer.add_force_n(0);
  answer.add_force_n(-1);
  EXPECT_FALSE(to_servo_answer(answer, {}, 0.002, 1).has_value());  // contact without a tangent
  for (int n = 0; n < 9; ++n) answer.add_tangent_n_m(n);
  const auto converted = to_servo_answer(answer, {}, 0.002, 1);
  ASSERT_TRUE(converted.has_value());
  EXPECT_EQ(converted->sample.tangent_n_m(1, 0), 3);
  EXPECT_TRUE(converted->sample.contact);
}

TEST(ServoMessages, NotCoveredIsNoForceAndFailedIsNoAnswer) {
  v1::TouchAnswer answer;
  answer.add_position_m(0);
  answer.add_position_m(0.004);
  answer.set_status(v1::TOUCH_STATUS_NOT_COVERED);
  const auto not_covered = to_servo_answer(answer, {}, 0.002, 1);
  ASSERT_TRUE(not_covered.has_value());
  EXPECT_TRUE(not_covered->has_force);
  EXPECT_FALSE(not_covered->covered);
  EXPECT_FALSE(not_covered->sample.contact);
  answer.set_status(v1::TOUCH_STATUS_FAILED);
  const auto failed = to_servo_answer(answer, {}, 0.002, 1);
  ASSERT_TRUE(failed.has_value());
  EXPECT_FALSE(failed->has_force);
}

TEST(ServoMessages, WhatIsForeseenIsASampleWithoutContact) {
  v1::TouchAnswer answer;
  answer.set_status(v1::TOUCH_STATUS_OK);
  for (const double m : {0.02, -0.003}) answer.add_position_m(m);
  for (int n = 0; n < 2; ++n) answer.add_force_n(0);
  const auto nothing = to_servo_answer(answer, {}, 0.002, 1);
  ASSERT_TRUE(nothing.has_value());
  EXPECT_FALSE(nothing->sample.contact || nothing->sample.foreseen);
  v1::ForeseenTouch& foreseen = *answer.mutable_foreseen();
  for (const double m : {0.02, 5e-4}) foreseen.add_position_m(m);
  for (const double n : {0.01, -0.2}) foreseen.add_force_n(n);
  EXPECT_FALSE(to_servo_answer(answer, {}, 0.002, 1).has_value());  // without a tangent
  for (int n = 0; n < 9; ++n) foreseen.add_tangent_n_m(n);
  const auto converted = to_servo_answer(answer, {}, 0.002, 1);
  ASSERT_TRUE(converted.has_value());
  const ForceSample& sample = converted->sample;
  EXPECT_FALSE(sample.contact);
  EXPECT_TRUE(sample.foreseen);
  EXPECT_EQ(sample.position_m, Vector3(0.02, 5e-4, 0));
  EXPECT_EQ(sample.force_n, Vector3(0.01, -0.2, 0));
  EXPECT_EQ(sample.tangent_n_m(1, 0), 3);
}

}  // namespace
}  // namespace teletact::client
