#include "client/session/operator_session.h"

#include <gtest/gtest.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <thread>
#include <vector>

#include "client/link/arrival_intervals.h"
#include "client/link/recording.h"
#include "client/render/force_limits.h"
#include "tests/link/fake_palpation.h"
#include "tests/session/full_disk.h"
#include "tests/session/session_options.h"
#include "tests/support/kept_log.h"

namespace teletact::client {
namespace {

using test::AnalyticTissue;
using test::answers_at_least;
using test::FakePalpation;

struct Felt {
  double first_x_m = 0;        // where it pressed first
  std::vector<double> errors;  // of the force, of ticks past the ramp and in contact
};

Felt felt_in(const std::string& path, const AnalyticTissue& tissue) {
  constexpr double kRampS = 0.5, kDeepM = 0.001;
  Felt out;
  double enabled_s = -1;
  RecordReader reader(path);
  while (const auto entry = reader.next()) {
    if (!entry->has_servo()) continue;
    const v1::ServoSample& tick = entry->servo();
    const double now_s = 1e-9 * static_cast<double>(entry->monotonic_ns());
    const bool on = tick.state() == static_cast<std::uint32_t>(ServoState::kEnabled) && !tick.faded();
    enabled_s = !on ? -1 : enabled_s < 0 ? now_s : enabled_s;
    if (out.first_x_m == 0 && tick.position_m(1) > 0) out.first_x_m = tick.position_m(0);
    if (!on || now_s - enabled_s < kRampS || tick.position_m(1) < kDeepM) continue;
    const Vector3 truth_n =
        tissue.answer({tick.position_m(0), tick.position_m(1), tick.position_m(2)}).force_n;
    const Vector3 felt_n(tick.force_n(0), tick.force_n(1), tick.force_n(2));
    out.errors.push_back((felt_n - truth_n).norm() / truth_n.norm());
  }
  return out;
}

// Tissue without inclusions, softer than any device's cap: what is felt is its force.
TEST(OperatorSession, FeelsASceneFromEndToEnd) {
  FakePalpation service(test::socket_address("session"));
  service.tissue.inclusions.clear();
  service.windows_m = {{0.03, 0.09}};
  service.serve();
  OperatorSessionOptions options = test::session_options(test::socket_address("session"));
  options.begin_m = 0;  // beside the window
  options.duration_s = 1.3;
  options.record_path = "/tmp/teletact-felt-" + std::to_string(::getpid());
  const std::atomic<bool> stop{false};
  TouchSummary summary = run_operator_session(options, stop);
  auto [first_x_m, errors] = felt_in(options.record_path, service.tissue);
  std::remove(options.record_path.c_str());
  EXPECT_GE(first_x_m, 0.0375) << "all of the tip is over the window";
  ASSERT_GT(errors.size(), 200u);
  std::nth_element(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2),
                   errors.end());
  std::printf("[ felt  ] median error %.4f of the tissue's force, %zu ticks\n", errors[errors.size() / 2],
              errors.size());
  EXPECT_LE(errors[errors.size() / 2], 0.05);
  EXPECT_GT(summary.ticks.largest_force_n(), 0.3);
  EXPECT_GT(summary.link.distinct, 100u);
  EXPECT_EQ(summary.ticks.stalls().count(), 0u);
  EXPECT_EQ(summary.telemetry_dropped, 0u);
  ASSERT_GE(summary.ticks.changes().size(), 2u);
  EXPECT_EQ(summary.ticks.changes()[1].state, ServoState::kEnabled);
}

struct Watched {
  std::size_t ticks = 0, answers = 0, lines = 0;
  double largest_force_n = 0;
  v1::SessionFigures figures;
  bool while_written = false;
};

// All of a session that is about to be recorded at `path`, as it is.
Watched watch_to_the_end(const std::string& path) {
  std::optional<RecordReader> reader;
  for (int n = 0; n < 500 && !reader; ++n) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    if (std::filesystem::exists(path)) reader.emplace(path);
  }
  Watched out;
  for (bool written = true; reader;) {
    const auto entry = reader->next();
    if (!entry && !written) break;
    written = entry || reader->is_written();
    if (!entry) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      continue;
    }
    out.while_written = out.while_written || (entry->has_servo() && reader->is_written());
    out.ticks += entry->has_servo();
    out.answers += entry->has_touch_response() && entry->touch_response().has_answer();
    out.lines += entry->has_log();
    if (entry->has_figures()) out.figures = entry->figures();
    for (const double force_n : entry->servo().force_n())
      out.largest_force_n = std::max(out.largest_force_n, std::abs(force_n));
  }
  return out;
}

// Whoever looks gets what is recorded meanwhile, and at the end the summary's figures.
TEST(OperatorSession, IsReadAsItIsRecorded) {
  const std::string path = "/tmp/teletact-watched-" + std::to_string(::getpid());
  FakePalpation service(test::socket_address("watched"));
  service.serve();
  OperatorSessionOptions options = test::session_options(test::socket_address("watched"));
  options.duration_s = 1;
  options.record_path = path;
  const std::atomic<bool> stop{false};
  TouchSummary summary;
  std::thread session([&] { summary = run_operator_session(options, stop); });
  const Watched watched = watch_to_the_end(path);
  session.join();
  std::filesystem::remove(path);
  EXPECT_TRUE(watched.while_written);
  EXPECT_GT(watched.ticks, 500u);
  EXPECT_GT(watched.answers, 100u);
  EXPECT_GT(watched.lines, 0u);
  EXPECT_EQ(watched.figures.ticks(), summary.ticks.ticks());
  EXPECT_EQ(watched.figures.answers(), summary.link.answers);
  EXPECT_EQ(watched.figures.largest_force_n(), summary.ticks.largest_force_n());
  EXPECT_EQ(summary.record_dropped, 0u);
}

// A disk that is full ends the recording, which is said, and not the force.
TEST(OperatorSession, AFullDiskEndsTheRecordingAlone) {
  const std::string record = "/tmp/teletact-full-" + std::to_string(::getpid()) + ".record";
  FakePalpation service(test::socket_address("full"));
  service.serve();
  OperatorSessionOptions options = test::session_options(test::socket_address("full"));
  options.duration_s = 1;
  options.record_path = record;
  const std::atomic<bool> stop{false};
  const test::FullDisk full(16 << 10);
  try {
    run_operator_session(options, stop);
    ADD_FAILURE();
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(std::string(error.what()),
              "the recording '" + record + "' is incomplete: writing failed (disk full?)");
  }
  EXPECT_LE(std::filesystem::file_size(record), 16u << 10);
  EXPECT_TRUE(service.wait_until(answers_at_least(300))) << "a second of touch";
  std::filesystem::remove(record);
}

// A scene that is deleted while it is touched may come back, but a duration is an end all the same.
TEST(OperatorSession, EndsInTimeThoughItsSceneIsGone) {
  FakePalpation service(test::socket_address("gone"));
  service.serve();
  OperatorSessionOptions options = test::session_options(test::socket_address("gone"));
  options.duration_s = 1.2;
  options.lost_s = 0.4;
  const std::atomic<bool> stop{false};
  TouchSummary summary;
  std::thread session([&] { summary = run_operator_session(options, stop); });
  ASSERT_TRUE(service.wait_until(answers_at_least(200)));
  service.scene_known = false;
  service.kill();
  service.serve();
  session.join();
  EXPECT_LT(summary.ticks.enabled_s(), options.duration_s);
  EXPECT_GE(summary.ticks.enabled_s() + summary.ticks.lost_s(), options.duration_s);
  EXPECT_GE(summary.ticks.lost_s(), options.lost_s - 0.1);
}

TEST(OperatorSession, NamesTheNearestLayerToTheDepth) {
  FakePalpation service(test::socket_address("layer"));
  service.layer_depth_m = 0.0139999999;
  service.serve();
  OperatorSessionOptions options = test::session_options(test::socket_address("layer"));
  options.duration_s = 0.1;
  const std::atomic<bool> stop{false};
  const auto says_layer = [&](double asked_m) {
    const teletact::test::KeptLog log;
    options.open.mutable_layer()->set_depth_m(asked_m);
    run_operator_session(options, stop);
    return log.has("no layer lies there; the nearest is touched, at 0.0140 m");
  };
  EXPECT_TRUE(says_layer(0.013));
  EXPECT_FALSE(says_layer(0.014)) << "a rounding is no other layer";
}

TEST(OperatorSession, RefusesASweepBesideTheTissue) {
  FakePalpation service(test::socket_address("beside"));
  service.serve();
  OperatorSessionOptions options = test::session_options(test::socket_address("beside"));
  const std::atomic<bool> stop{false};
  const auto refusal = [&](double begin_m, double end_m) -> std::string {
    options.begin_m = begin_m, options.end_m = end_m;
    try {
      run_operator_session(options, stop);
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
  options.hand.along_z = true;
  EXPECT_NE(refusal(0.01, 0.02).find("--along z: scene 's' is the same for every z"), std::string::npos);
  service.z_m = {-0.02, 0.03};
  EXPECT_NE(refusal(0.01, 0.05).find("--end-m 0.05: the tissue of scene 's' reaches from -0.02 to 0.03 m"),
            std::string::npos);
  options.across_m = 0.2;
  EXPECT_NE(refusal(0.01, 0.02).find("--across-m 0.2: the tissue of scene 's' reaches from 0 to 0.12 m"),
            std::string::npos);
}

// The service is killed while the finger presses, and comes back.
TEST(OperatorSession, KilledServiceLeavesNoForceUntilResumed) {
  FakePalpation service(test::socket_address("pressed"));
  service.serve();
  OperatorSessionOptions options = test::session_options(test::socket_address("pressed"));
  options.record_path = "/tmp/teletact-pressed-" + std::to_string(::getpid());
  const teletact::test::KeptLog log;
  std::atomic<bool> stop{false};
  TouchSummary summary;
  std::thread session([&] { summary = run_operator_session(options, stop); });
  EXPECT_TRUE(service.wait_until(answers_at_least(500)));  // a second: pressed and sweeping
  service.kill();
  EXPECT_TRUE(log.comes("servo PAUSED"));
  service.serve();
  EXPECT_TRUE(log.comes("servo ENABLED", 2));
  stop = true;
  session.join();

  std::int64_t paused_ns = 0;
  ArrivalIntervals arrivals;
  double answered_s = 0, silent_s = 0, limit_s = 0;  // at the last tick before that
  double last_m = 0, last_x_n = 0, last_y_n = 0, last_s = 0, at_kill_n = 0, worst = 0;
  RecordReader reader(options.record_path);
  while (const auto entry = reader.next()) {
    if (entry->has_touch_response() && paused_ns == 0) {
      arrivals.add(entry->monotonic_ns());
      answered_s = 1e-9 * static_cast<double>(entry->monotonic_ns());
      limit_s = silence_limits(std::max(arrivals.expected_s(), 0.002)).zero_s;
    }
    if (!entry->has_servo()) continue;
    const v1::ServoSample& servo = entry->servo();
    const double force_n = std::hypot(servo.force_n(0), servo.force_n(1));
    const double now_s = 1e-9 * static_cast<double>(entry->monotonic_ns());
    if (last_s > 0) {
      const double allowed_n =
          device_profile(options.profile).largest_slew_n_s() * std::min(now_s - last_s, 0.002);
      const double pressed_n =
          device_profile(options.profile).largest_stiffness_n_m * std::max(servo.position_m(1) - last_m, 0.0);
      worst = std::max(worst, force_n - std::hypot(last_x_n, last_y_n) - pressed_n - allowed_n);
    }
    last_m = servo.position_m(1);
    last_x_n = servo.force_n(0);
    last_y_n = servo.force_n(1);
    last_s = now_s;
    if (servo.state() == 2 && paused_ns == 0) {
      paused_ns = entry->monotonic_ns();
      EXPECT_EQ(force_n, 0);
    }
    if (paused_ns == 0) silent_s = now_s - answered_s;
    if (paused_ns == 0) at_kill_n = std::max(at_kill_n, force_n);
  }
  EXPECT_GT(at_kill_n, 0.3);
  ASSERT_GT(paused_ns, 0);
  EXPECT_LE(silent_s, limit_s);
  std::printf("[ pause ] %.3f s after the last answer, where %.3f s are allowed\n", silent_s, limit_s);
  EXPECT_LE(worst, 1e-9);
  // PAUSED for silence, then ENABLED again and pressed to the end.
  const auto& changes = summary.ticks.changes();
  ASSERT_GE(changes.size(), 4u);
  EXPECT_EQ(changes[2].reason, StateReason::kSilence);
  EXPECT_EQ(changes[3].state, ServoState::kEnabled);
  EXPECT_EQ(summary.link.streams, 2u);
  std::remove(options.record_path.c_str());
}

// Throws what a logger passes on, at the line that a test waits for.
class ThrowingSink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit ThrowingSink(std::string at) : at_(std::move(at)) {}

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    if (std::string_view(message.payload.data(), message.payload.size()).find(at_) != std::string_view::npos)
      throw 7;  // NOLINT: spdlog keeps std::exception to itself
  }
  void flush_() override {}
  std::string at_;
};

TEST(OperatorSession, ExceptionEndsTheSessionNotTheProcess) {
  FakePalpation service(test::socket_address("throws"));
  service.serve();
  OperatorSessionOptions options = test::session_options(test::socket_address("throws"));
  options.duration_s = 5;
  const std::atomic<bool> stop{false};
  const auto logger = spdlog::default_logger();
  spdlog::set_default_logger(
      std::make_shared<spdlog::logger>("t", std::make_shared<ThrowingSink>("DEGRADED by the service")));
  bool thrown = false;
  std::thread session([&] {
    try {
      run_operator_session(options, stop);
    } catch (int) {
      thrown = true;
    }
  });
  EXPECT_TRUE(service.wait_until(answers_at_least(500)));  // pressed
  service.doubts = true;
  session.join();
  spdlog::set_default_logger(logger);
  EXPECT_TRUE(thrown);
  options.servo_begins = [] { throw std::runtime_error("no memory"); };
  EXPECT_THROW(run_operator_session(options, stop), std::runtime_error);
}

TEST(OperatorSession, SaysWhatIsWrong) {
  const std::atomic<bool> stop{false};
  OperatorSessionOptions options = test::session_options(test::socket_address("wrong"));
  options.connect_s = 0.1;
  const auto message = [&] {
    try {
      run_operator_session(options, stop);
    } catch (const std::exception& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(message().find("no service at"), std::string::npos);
  options.connect_s = 2;
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
