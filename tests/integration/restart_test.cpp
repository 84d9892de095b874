// The service dies while the finger is pressed: what the operator feels, and how touch comes back. Whole
// processes: teletact-service with --state, teletact-client touch; the claims are read from its recording.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <vector>

#include "client/haptic/profiles.h"
#include "tests/integration/process.h"
#include "tests/integration/touched_scene.h"

namespace teletact {
namespace {

using client::ServoState;

constexpr double kAnswersWithinS = 1.0, kPressedM = 0.002;
constexpr const char* kScene = "restart";

// After the service says nothing any more (docs/reference/safety.md).
struct Rendering {
  const char* renderer;
  double zero_within_s;
};

// What the operator felt before, during and after the service was away.
struct Felt {
  double before_n = 0, worst_step = 0, zero_since_s = INFINITY, largest_after_n = 0;
  bool enabled_again = false;
};

Felt felt(const test::TouchRecording& recording, double killed_s) {
  const double slew_n_s = client::device_profile("premium-1.5").limits().largest_slew_n_s;
  Felt felt;
  for (std::size_t k = 1; k < recording.ticks.size(); ++k) {
    const test::TouchTick &tick = recording.ticks[k], &before = recording.ticks[k - 1];
    const double rise_n = tick.rise_n(before);
    EXPECT_TRUE(std::isfinite(rise_n));
    felt.worst_step =
        std::max(felt.worst_step, rise_n / (slew_n_s * std::max(tick.time_s - before.time_s, 0.001)));
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

void judge(const test::TouchRecording& recording, double killed_s, double serving_s, double zero_within_s) {
  const Felt operator_felt = felt(recording, killed_s);
  EXPECT_GT(operator_felt.before_n, 0.1) << "the finger was not pressed when the service died";
  EXPECT_LE(operator_felt.zero_since_s - killed_s, zero_within_s);
  EXPECT_LE(operator_felt.worst_step, 1 + 1e-3) << "steps are in units of the slew limit";
  EXPECT_TRUE(operator_felt.enabled_again);
  EXPECT_GT(operator_felt.largest_after_n, 0.1) << "force did not return";
  const double answer_s = recording.answer_after_s(killed_s + zero_within_s);
  EXPECT_LE(answer_s - serving_s, kAnswersWithinS);
  std::printf(
      "force zero %.0f ms after the kill; answers %.2f s after serving; largest rise %.2f of the slew "
      "limit\n",
      (operator_felt.zero_since_s - killed_s) * 1e3, answer_s - serving_s, operator_felt.worst_step);
}

class Restart : public testing::TestWithParam<Rendering> {};

TEST_P(Restart, ForceFadesAndReturnsOnlyOutOfContact) {
  test::TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "s");
  const std::vector<std::string> serve{test::service_binary(), "serve", "--listen", address, "--state",
                                       folder / "state"};
  auto service = std::make_unique<test::Process>(serve, folder / "service1.log");
  ASSERT_TRUE(service->says("serving on", 300)) << service->output();
  test::create_touched_scene(address, kScene);
  test::Process touch(test::touch_command(address, kScene, folder / "touch.record", GetParam().renderer),
                      folder / "touch.log");
  ASSERT_TRUE(test::finger_presses(address, kScene, kPressedM, 30)) << touch.output();
  std::this_thread::sleep_for(std::chrono::milliseconds(800));  // past the start ramp
  const double killed_s = test::now_s();
  service->kill(SIGKILL);
  service->wait(10);
  std::this_thread::sleep_for(std::chrono::milliseconds(700));
  service = std::make_unique<test::Process>(serve, folder / "service2.log");
  ASSERT_TRUE(service->says("serving on", 300)) << service->output();
  const double serving_s = test::now_s();
  ASSERT_TRUE(test::finger_presses(address, kScene, kPressedM, 30)) << touch.output();
  std::this_thread::sleep_for(std::chrono::milliseconds(800));
  touch.kill(SIGINT);
  ASSERT_EQ(touch.wait(20), 0) << touch.output();
  EXPECT_NE(touch.output().find("no answer from the service"), std::string::npos)
      << "the client did not say why:\n"
      << touch.output();

  judge(test::read_touch_recording(folder / "touch.record"), killed_s, serving_s, GetParam().zero_within_s);
}

INSTANTIATE_TEST_SUITE_P(By, Restart, testing::Values(Rendering{"law", 0.5}, Rendering{"kalman", 0.15}),
                         [](const auto& test) { return test.param.renderer; });

}  // namespace
}  // namespace teletact
