// The service dies while the finger is pressed: what the operator feels, and how touch comes back. Whole
// processes: teletact-service with --state, teletact-client touch; the claims are read from its recording.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstring>
#include <functional>
#include <memory>
#include <vector>

#include "client/haptic/profiles.h"
#include "client/link/channel.h"
#include "client/link/recording.h"
#include "client/servo/states.h"
#include "teletact/v1/palpation.grpc.pb.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

using client::ServoState;

constexpr double kZeroWithinS = 0.150, kAnswersWithinS = 2.0, kPressedM = 0.002;

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// 120 x 40 mm of 10 kPa, touchable at once.
v1::CreateSceneRequest explicit_scene() {
  v1::CreateSceneRequest request;
  request.set_scene_id("restart");
  request.mutable_geometry()->add_size_m(0.12);
  request.mutable_geometry()->add_size_m(0.04);
  constexpr int kColumns = 120, kRows = 40;
  v1::ModulusMap& map = *request.mutable_modulus();
  for (int i = 0; i <= kColumns; ++i) map.add_x_m(0.12 * i / kColumns);
  for (int j = 0; j <= kRows; ++j) map.add_y_m(0.04 * j / kRows);
  const std::vector<double> modulus(kColumns * kRows, 10e3);
  v1::Array& array = *map.mutable_youngs_modulus_pa();
  array.set_dtype(v1::DATA_TYPE_FLOAT64);
  array.add_shape(kRows);
  array.add_shape(kColumns);
  array.set_data(std::string(reinterpret_cast<const char*>(modulus.data()), modulus.size() * sizeof(double)));
  return request;
}

void create_explicit_scene(const std::string& address) {
  const auto stub = v1::Palpation::NewStub(client::make_channel(address));
  grpc::ClientContext context;
  v1::Scene scene;
  const grpc::Status status = stub->CreateScene(&context, explicit_scene(), &scene);
  ASSERT_TRUE(status.ok()) << client::describe(status);
}

// True once the finger of the scene is deeper than `depth_m`, within `seconds`.
bool finger_presses(const std::string& address, double depth_m, double seconds) {
  const auto stub = v1::Palpation::NewStub(client::make_channel(address));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() +
                       std::chrono::milliseconds(static_cast<int>(seconds * 1e3)));
  v1::WatchFingerRequest request;
  request.set_scene_id("restart");
  const auto stream = stub->WatchFinger(&context, request);
  for (v1::FingerState state; stream->Read(&state);)
    if (state.present() && state.position_m_size() > 1 && state.position_m(1) > depth_m) {
      context.TryCancel();
      return true;
    }
  return false;
}

struct Tick {
  double time_s, y_m, force_n[2];
  ServoState state;
  double size_n() const { return std::hypot(force_n[0], force_n[1]); }
};

struct Recording {
  std::vector<Tick> ticks;
  std::vector<double> answers_s;
};

Recording read(const std::string& path) {
  Recording recording;
  client::RecordReader reader(path);
  while (const auto entry = reader.next()) {
    const double time_s = entry->monotonic_ns() * 1e-9;
    if (entry->has_servo()) {
      const v1::ServoSample& s = entry->servo();
      recording.ticks.push_back(
          {time_s, s.position_m(1), {s.force_n(0), s.force_n(1)}, static_cast<ServoState>(s.state())});
    }
    if (entry->has_touch_response() && entry->touch_response().has_answer())
      recording.answers_s.push_back(time_s);
  }
  return recording;
}

std::vector<std::string> touch_command(const std::string& address, const std::string& record) {
  return {
      test::client_binary(), "touch", "--service", address, "--scene",         "restart", "--wait-s", "10",
      "--begin-m",           "0.03",  "--end-m",   "0.09",  "--indentation-m", "0.004",   "--record", record};
}

// What the operator felt before, during and after the service was away.
struct Felt {
  double before_n = 0, worst_step = 0, zero_since_s = INFINITY, largest_after_n = 0;
  bool enabled_again = false;
};

Felt felt(const Recording& recording, double killed_s) {
  const double slew_n_s = client::device_profile("premium-1.5").limits().largest_slew_n_s;
  Felt felt;
  for (std::size_t k = 1; k < recording.ticks.size(); ++k) {
    const Tick &tick = recording.ticks[k], &before = recording.ticks[k - 1];
    const double step_n =
        std::hypot(tick.force_n[0] - before.force_n[0], tick.force_n[1] - before.force_n[1]);
    EXPECT_TRUE(std::isfinite(step_n));
    felt.worst_step =
        std::max(felt.worst_step, step_n / (slew_n_s * std::max(tick.time_s - before.time_s, 0.001)));
    const double since_kill_s = tick.time_s - killed_s;
    if (since_kill_s < 0) felt.before_n = tick.size_n();
    if (since_kill_s > 0 && tick.state == ServoState::kEnabled && before.state != ServoState::kEnabled) {
      felt.enabled_again = true;
      EXPECT_LT(tick.y_m, 0) << "force was given back in contact";
      EXPECT_GT(since_kill_s, 0.5) << "force was given back while the service was away";
    }
    if (felt.enabled_again) {
      felt.largest_after_n = std::max(felt.largest_after_n, tick.size_n());
    } else if (since_kill_s > 0 && tick.size_n() == 0) {
      felt.zero_since_s = std::min(felt.zero_since_s, tick.time_s);
    } else if (since_kill_s > 0 && std::isfinite(felt.zero_since_s)) {
      ADD_FAILURE() << tick.size_n() << " N " << since_kill_s << " s after the service was killed";
    }
  }
  return felt;
}

void judge(const Recording& recording, double killed_s, double serving_s) {
  const Felt operator_felt = felt(recording, killed_s);
  EXPECT_GT(operator_felt.before_n, 0.1) << "the finger was not pressed when the service died";
  EXPECT_LE(operator_felt.zero_since_s - killed_s, kZeroWithinS);
  EXPECT_LE(operator_felt.worst_step, 1 + 1e-3) << "steps are in units of the slew limit";
  EXPECT_TRUE(operator_felt.enabled_again);
  EXPECT_GT(operator_felt.largest_after_n, 0.1) << "force did not return";
  const auto answer = std::find_if(recording.answers_s.begin(), recording.answers_s.end(),
                                   [&](double t) { return t > killed_s + kZeroWithinS; });
  ASSERT_NE(answer, recording.answers_s.end());
  EXPECT_LE(*answer - serving_s, kAnswersWithinS);
  std::printf(
      "force zero %.0f ms after the kill; answers %.2f s after serving; largest step %.2f of the slew "
      "limit\n",
      (operator_felt.zero_since_s - killed_s) * 1e3, *answer - serving_s, operator_felt.worst_step);
}

TEST(Restart, KilledWhilePressedTheForceFadesSaysWhyAndReturnsOnlyOutOfContact) {
  test::TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "s");
  const std::vector<std::string> serve{test::service_binary(), "serve", "--listen", address, "--state",
                                       folder / "state"};
  auto service = std::make_unique<test::Process>(serve, folder / "service1.log");
  ASSERT_TRUE(service->says("serving on", 300)) << service->output();
  create_explicit_scene(address);
  test::Process touch(touch_command(address, folder / "touch.record"), folder / "touch.log");
  ASSERT_TRUE(finger_presses(address, kPressedM, 30)) << touch.output();
  std::this_thread::sleep_for(std::chrono::milliseconds(800));  // past the start ramp
  const double killed_s = now_s();
  service->kill(SIGKILL);
  service->wait(10);
  std::this_thread::sleep_for(std::chrono::milliseconds(700));
  service = std::make_unique<test::Process>(serve, folder / "service2.log");
  ASSERT_TRUE(service->says("serving on", 300)) << service->output();
  const double serving_s = now_s();
  ASSERT_TRUE(finger_presses(address, kPressedM, 30)) << touch.output();
  std::this_thread::sleep_for(std::chrono::milliseconds(800));
  touch.kill(SIGINT);
  ASSERT_EQ(touch.wait(20), 0) << touch.output();
  EXPECT_NE(touch.output().find("no answer from the service"), std::string::npos)
      << "the client did not say why:\n"
      << touch.output();

  judge(read(folder / "touch.record"), killed_s, serving_s);
}

}  // namespace
}  // namespace teletact
