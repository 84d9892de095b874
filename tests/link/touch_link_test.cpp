#include "client/link/touch_link.h"

#include <gtest/gtest.h>

#include "client/link/convert.h"
#include "client/link/replay.h"
#include "client/link/touch_session.h"
#include "tests/link/fake_palpation.h"

namespace teletact::client {
namespace {

using test::FakeAccount;
using test::FakePalpation;

// Poses at 1 kHz as a servo would give them, and the newest answer.
class Operator {
 public:
  explicit Operator(const std::string& address, double dead_s = 1.0) {
    options.address = address;
    options.open.set_scene_id("s");
    options.open.set_period_s(0.001);
    options.open.set_credit(2);
    options.dead_s = dead_s;
    link = std::make_unique<TouchLink>(options, poses, answers, clock);
    servo = std::thread([this] {
      std::int64_t due_ns = clock.now_ns();
      for (double x_m = 0.02; !stop; x_m += 1e-6) {
        ServoPose pose;
        pose.pose.position_m = Vector2(x_m, 0.004);
        pose.time_ns = clock.now_ns();
        poses.put(pose);
        clock.sleep_until_ns(due_ns += 1'000'000);
      }
    });
    link->start();
  }
  ~Operator() {
    stop = true;
    servo.join();
    link->stop();
  }
  MonotonicClock clock;
  TouchLinkOptions options;
  LatestSlot<ServoPose> poses;
  LatestSlot<ServoAnswer> answers;
  std::unique_ptr<TouchLink> link;
  std::atomic<bool> stop{false};
  std::thread servo;
};

auto answers_at_least(std::uint64_t count) {
  return [count](const FakeAccount& account) { return account.answers >= count; };
}

TEST(TouchLink, CreditIsNeverExceededAndPosesAreInOrder) {
  FakePalpation service(test::socket_address("credit"));
  service.credit = 2;
  service.compute_s = 0.003;  // slower than the poses come
  service.serve();
  Operator person(test::socket_address("credit"));
  ASSERT_TRUE(service.wait_until(answers_at_least(100)));
  const FakeAccount account = service.account();
  EXPECT_LE(account.most_unacknowledged, 2u);
  EXPECT_LE(account.most_unanswered, 2u);
  EXPECT_EQ(account.disorder, 0u);
  EXPECT_EQ(account.wrong_acknowledgements, 0u);
  EXPECT_EQ(account.streams, 1u);
}

TEST(TouchLink, TheNewestPoseWins) {
  // GIVEN a service that takes 40 poses' time per answer, THEN each pose it gets is still fresh.
  FakePalpation service(test::socket_address("newest"));
  service.credit = 1;
  service.compute_s = 0.04;
  service.serve();
  Operator person(test::socket_address("newest"));
  ASSERT_TRUE(service.wait_until(answers_at_least(10)));
  EXPECT_LE(service.account().oldest_pose_s, 0.1);
  EXPECT_LE(service.account().poses, 15u);
}

TEST(TouchLink, AnswersCarryTheirOwnPose) {
  FakePalpation service(test::socket_address("pair"));
  service.serve();
  Operator person(test::socket_address("pair"));
  ASSERT_TRUE(service.wait_until(answers_at_least(20)));
  ServoAnswer answer;
  ASSERT_TRUE(person.answers.take(answer));
  EXPECT_TRUE(answer.has_force);
  EXPECT_TRUE(answer.covered);
  const ForceSample truth = service.tissue.answer(answer.sample.position_m);
  EXPECT_LE((answer.sample.force_n - truth.force_n).norm(), 1e-12);
  EXPECT_LE((answer.sample.tangent_n_m - truth.tangent_n_m).norm(), 1e-9);
  EXPECT_GT(answer.received_ns * 1e-9, answer.sample.pose_time_s);
  const TouchLinkStats stats = person.link->stats();
  EXPECT_EQ(stats.dropped, 0u);
  EXPECT_GE(stats.distinct, 19u);
}

TEST(TouchLink, AnswersFlowAgainAfterTheServiceWasKilledAndRestarted) {
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
  Operator person(test::socket_address("half"), 0.2);
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
  ASSERT_GE(stats.round_trips_s.size(), 49u);
  auto round_trips_s = stats.round_trips_s;
  EXPECT_LT(percentile(round_trips_s, 0.1), 0.005);
}

TEST(TouchLink, StopsAtOnceWithoutAService) {
  Operator person(test::socket_address("nobody"));
  EXPECT_EQ(person.link->stats().streams, 0u);
}

TEST(Convert, AMalformedAnswerIsDropped) {
  v1::TouchAnswer answer;
  answer.set_status(v1::TOUCH_STATUS_OK);
  EXPECT_FALSE(to_servo_answer(answer, 0, 0.002, 1).has_value());
  answer.add_position_m(0);
  answer.add_position_m(0.004);
  EXPECT_FALSE(to_servo_answer(answer, 0, 0.002, 1).has_value());  // no force
  answer.add_force_n(0);
  answer.add_force_n(-1);
  EXPECT_FALSE(to_servo_answer(answer, 0, 0.002, 1).has_value());  // contact without a tangent
  for (int n = 0; n < 9; ++n) answer.add_tangent_n_m(n);
  const auto converted = to_servo_answer(answer, 0, 0.002, 1);
  ASSERT_TRUE(converted.has_value());
  EXPECT_EQ(converted->sample.tangent_n_m(1, 0), 3);
  EXPECT_TRUE(converted->sample.contact);
}

TEST(Convert, NotCoveredIsNoForceAndFailedIsNoAnswer) {
  v1::TouchAnswer answer;
  answer.add_position_m(0);
  answer.add_position_m(0.004);
  answer.set_status(v1::TOUCH_STATUS_NOT_COVERED);
  const auto not_covered = to_servo_answer(answer, 0, 0.002, 1);
  ASSERT_TRUE(not_covered.has_value());
  EXPECT_TRUE(not_covered->has_force);
  EXPECT_FALSE(not_covered->covered);
  EXPECT_FALSE(not_covered->sample.contact);
  answer.set_status(v1::TOUCH_STATUS_FAILED);
  const auto failed = to_servo_answer(answer, 0, 0.002, 1);
  ASSERT_TRUE(failed.has_value());
  EXPECT_FALSE(failed->has_force);
}

TEST(TouchSession, FeelsASceneFromEndToEnd) {
  FakePalpation service(test::socket_address("session"));
  service.serve();
  TouchSessionOptions options;
  options.address = test::socket_address("session");
  options.open.set_scene_id("s");
  options.open.set_period_s(0.002);
  options.open.set_credit(2);
  options.duration_s = 1.5;
  options.real_time = false;  // not for the threads of a test binary
  const std::atomic<bool> stop{false};
  TouchSummary summary = run_touch_session(options, stop);
  EXPECT_GT(summary.ticks.largest_force_n(), 0.3);
  EXPECT_GT(summary.link.distinct, 100u);
  EXPECT_EQ(summary.ticks.stalls().count(), 0u);
  EXPECT_EQ(summary.telemetry_dropped, 0u);
  ASSERT_GE(summary.ticks.changes().size(), 2u);
  EXPECT_EQ(summary.ticks.changes()[1].state, ServoState::kEnabled);
}

// A scene that is deleted while it is touched may come back, but a duration is an end all the same.
TEST(TouchSession, EndsInTimeThoughItsSceneIsGone) {
  FakePalpation service(test::socket_address("gone"));
  service.serve();
  TouchSessionOptions options;
  options.address = test::socket_address("gone");
  options.open.set_scene_id("s");
  options.open.set_period_s(0.002);
  options.duration_s = 2;
  options.real_time = false;
  const std::atomic<bool> stop{false};
  TouchSummary summary;
  std::thread session([&] { summary = run_touch_session(options, stop); });
  ASSERT_TRUE(service.wait_until(answers_at_least(200)));
  service.scene_known = false;
  service.kill();
  service.serve();
  session.join();
  EXPECT_LT(summary.ticks.enabled_s(), 2);
  EXPECT_GE(summary.ticks.lost_s(), TouchSessionOptions::kLostS - 0.1);
  EXPECT_LT(summary.ticks.lost_s(), TouchSessionOptions::kLostS + 1);
}

TEST(TouchSession, RefusesASweepBesideTheTissue) {
  FakePalpation service(test::socket_address("beside"));
  service.serve();
  TouchSessionOptions options;
  options.address = test::socket_address("beside");
  options.open.set_scene_id("s");
  options.real_time = false;
  const std::atomic<bool> stop{false};
  const auto refusal = [&](double begin_m, double end_m) -> std::string {
    options.begin_m = begin_m, options.end_m = end_m;
    try {
      run_touch_session(options, stop);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_NE(refusal(10, 290).find("--begin-m 10: the tissue of scene 's' reaches from 0 to 0.12 m"),
            std::string::npos);
  EXPECT_NE(refusal(0.01, 0.29).find("--end-m 0.29"), std::string::npos);
  EXPECT_NE(refusal(-0.01, 0.1).find("--begin-m"), std::string::npos);
  EXPECT_NE(refusal(0.01, NAN).find("--end-m"), std::string::npos);
}

TEST(Replay, FindsTheRecordedForcesAgainAndSeesAChange) {
  FakePalpation service(test::socket_address("replay"));
  service.serve();
  TouchSessionOptions options;
  options.address = test::socket_address("replay");
  options.open.set_scene_id("s");
  options.open.set_period_s(0.002);
  options.duration_s = 0.6;
  options.real_time = false;
  options.record_path = "/tmp/teletact-replay-" + std::to_string(::getpid());
  const std::atomic<bool> stop{false};
  const TouchSummary summary = run_touch_session(options, stop);
  ReplayOptions replay_options;
  replay_options.path = options.record_path;
  replay_options.address = options.address;
  replay_options.speed = 0;
  const ReplayReport same = replay(replay_options, stop);
  EXPECT_EQ(same.kind, "touch");
  EXPECT_GE(same.compared + 2, summary.link.answers);
  EXPECT_GT(same.compared, 50u);
  EXPECT_EQ(same.not_alike, 0u);
  EXPECT_LE(same.largest_force_difference_n, 1e-12);
  service.harden(1.5);
  const ReplayReport other = replay(replay_options, stop);
  EXPECT_GT(other.largest_force_difference_n, 0.1);
  std::remove(options.record_path.c_str());
}

// The service is killed while the finger presses, and comes back.
TEST(TouchSession, ForceIsZeroWithin150MillisecondsOfAKillAndReturnsOnResume) {
  FakePalpation service(test::socket_address("pressed"));
  service.serve();
  TouchSessionOptions options;
  options.address = test::socket_address("pressed");
  options.open.set_scene_id("s");
  options.open.set_period_s(0.002);
  options.duration_s = 2.5;
  options.real_time = false;
  options.record_path = "/tmp/teletact-pressed-" + std::to_string(::getpid());
  const std::atomic<bool> stop{false};
  TouchSummary summary;
  std::thread session([&] { summary = run_touch_session(options, stop); });
  ASSERT_TRUE(service.wait_until(answers_at_least(500)));  // a second: pressed and sweeping
  service.kill();
  std::this_thread::sleep_for(std::chrono::milliseconds(400));
  service.serve();
  session.join();

  std::int64_t paused_ns = 0, last_answer_ns = 0, answer_before_ns = 0;
  double last_x_n = 0, last_y_n = 0, last_s = 0, at_kill_n = 0, worst = 0;
  RecordReader reader(options.record_path);
  while (const auto entry = reader.next()) {
    if (entry->has_touch_response() && paused_ns == 0) last_answer_ns = entry->monotonic_ns();
    if (!entry->has_servo()) continue;
    const v1::ServoSample& servo = entry->servo();
    const double force_n = std::hypot(servo.force_n(0), servo.force_n(1));
    const double now_s = 1e-9 * static_cast<double>(entry->monotonic_ns());
    if (last_s > 0) {
      const double allowed_n =
          device_profile(options.profile).largest_slew_n_s() * std::min(now_s - last_s, 0.002);
      worst =
          std::max(worst, std::hypot(servo.force_n(0) - last_x_n, servo.force_n(1) - last_y_n) - allowed_n);
    }
    last_x_n = servo.force_n(0);
    last_y_n = servo.force_n(1);
    last_s = now_s;
    if (servo.state() == 2 && paused_ns == 0) {
      paused_ns = entry->monotonic_ns();
      answer_before_ns = last_answer_ns;
      EXPECT_EQ(force_n, 0);
    }
    if (paused_ns == 0) at_kill_n = std::max(at_kill_n, force_n);
  }
  EXPECT_GT(at_kill_n, 0.3);
  ASSERT_GT(paused_ns, 0);
  EXPECT_LE(1e-9 * static_cast<double>(paused_ns - answer_before_ns),
            0.18);  // and a late tick of a busy machine
  EXPECT_LE(worst, 1e-9);
  // PAUSED for silence, then ENABLED again and pressed to the end.
  const auto& changes = summary.ticks.changes();
  ASSERT_GE(changes.size(), 4u);
  EXPECT_EQ(changes[2].reason, StateReason::kSilence);
  EXPECT_EQ(changes[3].state, ServoState::kEnabled);
  EXPECT_EQ(summary.link.streams, 2u);
  std::remove(options.record_path.c_str());
}

TEST(TouchSession, SaysWhatIsWrong) {
  const std::atomic<bool> stop{false};
  TouchSessionOptions options;
  options.address = test::socket_address("wrong");
  options.open.set_scene_id("s");
  const auto message = [&] {
    try {
      run_touch_session(options, stop);
    } catch (const std::exception& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(message().find("no service at"), std::string::npos);
  FakePalpation service(options.address);
  service.scene_known = false;
  service.serve();
  EXPECT_NE(message().find("NOT_FOUND: scene 's' is unknown"), std::string::npos);
  service.scene_known = true;
  options.record_path = "/nonexistent/folder/file";
  EXPECT_NE(message().find("cannot write the recording"), std::string::npos);
  options.record_path.clear();
  options.profile = "spoon";
  EXPECT_NE(message().find("unknown device profile"), std::string::npos);
  options.profile = "omni";
  options.device = "spoon";
  EXPECT_NE(message().find("unknown device"), std::string::npos);
}

}  // namespace
}  // namespace teletact::client
