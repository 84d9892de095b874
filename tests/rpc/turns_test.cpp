// Layers that touches wait for are made ready in turns of the clients.
#include <atomic>
#include <future>
#include <thread>

#include "tests/rpc/running_server.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

using Turns = OnOneServer;

v1::TouchOpen on_layer(double y_m) {
  v1::TouchOpen open = Toucher::open_on("s");
  open.mutable_layer()->set_depth_m(y_m);
  return open;
}

TEST_F(Turns, OneWhoWaitsForManyLayersKeepsNobodyWaiting) {
  const auto scene = (*server)->core().scenes.find("s");
  const auto is_made = [&](double y_m) {
    constexpr double kRowM = 0.002;  // apart
    const auto row = static_cast<std::size_t>(std::lround(y_m / kRowM));
    return tissue_of(*scene->snapshot()->windows[0]).ready(row) != nullptr;
  };
  const auto wait_until = [](const auto& condition) {
    for (int k = 0; k < 4000 && !condition(); ++k) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    return condition();
  };
  // GIVEN somebody at work, behind whom one client asks for two layers, and then another for one
  struct Gates {
    std::atomic<bool> first_done{false}, last_begun{false}, last_done{false};
  };
  const auto gates = std::make_shared<Gates>();
  scene->touch_work()("a", [=] { wait_until([&gates = *gates] { return gates.first_done.load(); }); });
  std::vector<std::unique_ptr<Toucher>> touching;
  const auto ask = [&](const char* client, double y_m) {
    touching.push_back(std::make_unique<Toucher>(channel, on_layer(y_m), client));
    v1::TouchAnswer answer;
    ASSERT_TRUE(touching.back()->opened());
    ASSERT_TRUE(touching.back()->send(0.05, y_m + 0.002) && touching.back()->read(&answer));
    ASSERT_EQ(answer.status(), v1::TOUCH_STATUS_PREPARING);
  };
  ask("greedy", 0.010), ask("greedy", 0.014), ask("modest", 0.018);
  scene->touch_work()("z", [=] {
    gates->last_begun = true;
    wait_until([&gates = *gates] { return gates.last_done.load(); });
  });
  // WHEN each had a turn
  gates->first_done = true;
  ASSERT_TRUE(wait_until([&] { return gates->last_begun.load(); }));
  // THEN one line of either is there
  EXPECT_TRUE(is_made(0.010));
  EXPECT_TRUE(is_made(0.018));
  EXPECT_FALSE(is_made(0.014));
  gates->last_done = true;
  EXPECT_TRUE(wait_until([&] { return is_made(0.014); }));
}

}  // namespace
}  // namespace teletact::service
