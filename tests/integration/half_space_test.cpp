// A model in three dimensions through the whole chain, service and client: what a hand feels has all
// components.
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <thread>

#include "client/link/touch_link.h"
#include "client/render/renderers.h"
#include "client/servo/servo_thread.h"
#include "tests/rpc/running_server.h"
#include "tests/scene/half_space.h"

namespace teletact {
namespace {

constexpr double kX = 0.05, kZ = 0.015, kIndentationM = 0.002;

// Over one place of the tilted surface; presses once force is on.
class PressingDevice final : public client::HapticDevice {
 public:
  const client::DeviceProfile& profile() const noexcept override {
    return client::device_profile("premium-1.5");
  }
  void open() override {}
  void close() noexcept override {}
  bool read(std::int64_t, client::DeviceReading& reading) noexcept override {
    constexpr double kStepM = 2e-5;  // a tick
    const bool presses = force_on_ && indentation_m_ < kIndentationM;
    if (presses) indentation_m_ += kStepM;
    const auto at = service::on_tilted_surface(kX, kZ, indentation_m_);
    reading.pose.position_m = client::Vector3::Map(at.data());
    reading.pose.velocity_m_s.setZero();
    reading.resume_pressed = !force_on_ && ++reads_ % 100 >= 50;
    return true;
  }
  bool write(const client::Vector3& force_n) noexcept override {
    forces_n.put(force_n);
    return true;
  }
  void show(const client::OperatorView& view) noexcept override { force_on_ = view.force_on; }
  client::LatestSlot<client::Vector3> forces_n;

 private:
  double indentation_m_ = -0.002;
  unsigned reads_ = 0;
  bool force_on_ = false;
};

client::Vector3 closed_form_n() {
  const service::HalfSpace half_space(10e3, 0.49, {});
  const auto surface = half_space.layer(service::tilted_surface(), {}, {});
  const service::ContactAnswer answer =
      surface->answer({}, {service::on_tilted_surface(kX, kZ, kIndentationM)});
  return client::Vector3::Map(answer.force_n.data());
}

TEST(HalfSpaceChain, IsFeltWithAllItsComponents) {
  service::RunningServer server("", "", {}, std::make_shared<const service::HalfSpaces>());
  server->make_ready();
  ASSERT_TRUE(server.create(service::uniform_scene("s", 10e3)).ok());
  const client::Vector3 expected_n = closed_form_n();
  EXPECT_GT(expected_n.norm(), 0.1);
  EXPECT_GT(expected_n.cwiseAbs().minCoeff(), 0.01);
  for (const char* renderer : {"law", "kalman"}) {
    PressingDevice device;
    const auto rendered = client::make_renderer(renderer, client::ServoOptions().period_s);
    client::MonotonicClock clock;
    client::ServoOptions options;
    options.chain.limits = device.profile().limits();
    const auto servo = std::make_unique<client::ServoLoop>(device, *rendered, clock, options);
    client::TouchLinkOptions link_options;
    link_options.address = server->address();
    link_options.open = service::Toucher::open_on("s");
    client::TouchLink link(link_options, servo->poses(), servo->answers(), clock);
    client::ServoThread thread(*servo, {.real_time = false});
    link.start();
    client::Vector3 felt_n = client::Vector3::Zero();
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while ((felt_n - expected_n).norm() > 0.01 * expected_n.norm() &&
           std::chrono::steady_clock::now() < end) {
      device.forces_n.take(felt_n);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    EXPECT_LE((felt_n - expected_n).norm(), 0.01 * expected_n.norm())
        << renderer << ": " << felt_n.transpose() << " instead of " << expected_n.transpose();
  }
}

}  // namespace
}  // namespace teletact
