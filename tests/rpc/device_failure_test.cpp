// A device that fails under estimates, or under touches alone: said by the health of Elastography, opened
// anew, and used again. Touch goes on from compliances.
#include "service/device/device.h"
#include "tests/rpc/estimate_client.h"
#include "tests/rpc/health.h"

namespace teletact::service {
namespace {

grpc::Status status_of_estimate(const RunningServer& server) {
  return estimate(server.channel(), acquisition()).status;
}

// The finger goes on meanwhile: opening a device may take longer than a stream may be silent, where its
// kernels are compiled on a busy machine.
bool becomes(const RunningServer& server, int health, Toucher& toucher) {
  v1::TouchAnswer answer;
  for (int k = 0; k < 1200; ++k) {
    if (health_of(server, kElastography) == health) return true;
    if (!toucher.touch(0.02, 0.003, &answer)) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  return false;
}

// Presses at one place after the other until it is answered so.
bool comes_to(Toucher& toucher, v1::TouchStatus status) {
  v1::TouchAnswer answer;
  for (int k = 0; k < 1200; ++k) {
    if (!toucher.touch(0.02 + 0.002 * (k % 30), 0.003, &answer)) return false;
    if (answer.status() == status) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return false;
}

v1::TouchOpen by_device(const std::string& scene) {
  v1::TouchOpen open = Toucher::open_on(scene);
  open.set_path(v1::SOLVE_PATH_GRADIENTS);
  return open;
}

struct FailingLaunches {
  FailingLaunches() { fail_launches(true); }
  ~FailingLaunches() { fail_launches(false); }
};

TEST(DeviceFailure, IsSaidAndTheDeviceComesBack) {
  RunningServer server;
  server->make_ready();
  ASSERT_TRUE(server.create(uniform_scene("touched")).ok());
  Bystander touching(server.channel(), "touched");
  Toucher pressing(server.channel(), by_device("touched"));
  ASSERT_TRUE(pressing.opened());
  ASSERT_TRUE(comes_to(pressing, v1::TOUCH_STATUS_OK));
  ASSERT_TRUE(status_of_estimate(server).ok());
  {
    const FailingLaunches failing;
    expect_refused(status_of_estimate(server), grpc::StatusCode::UNAVAILABLE, "reopened");
    ASSERT_TRUE(becomes(server, kNotServing, pressing));
    EXPECT_EQ(health_of(server, "teletact.v1.Palpation"), kServing);
    EXPECT_TRUE(comes_to(pressing, v1::TOUCH_STATUS_FAILED));
    EXPECT_EQ(status_of_estimate(server).error_code(), grpc::StatusCode::UNAVAILABLE);  // refused at once
    EXPECT_EQ(health_of(server, kElastography), kNotServing);
  }
  ASSERT_TRUE(becomes(server, kServing, pressing));
  const grpc::Status status = status_of_estimate(server);
  EXPECT_TRUE(status.ok()) << status.error_message();
  EXPECT_TRUE(comes_to(pressing, v1::TOUCH_STATUS_OK));  // by the new device
  touching.stop();
  EXPECT_EQ(touching.failures(), 0);
}

TEST(DeviceFailure, UnderTouchesAloneIsSaidAndTheDeviceComesBack) {
  RunningServer server;
  server->make_ready();
  ASSERT_TRUE(server.create(uniform_scene("touched")).ok());
  Toucher pressing(server.channel(), by_device("touched"));
  ASSERT_TRUE(pressing.opened());
  ASSERT_TRUE(comes_to(pressing, v1::TOUCH_STATUS_OK));
  {
    const FailingLaunches failing;
    ASSERT_TRUE(comes_to(pressing, v1::TOUCH_STATUS_FAILED));
    ASSERT_TRUE(becomes(server, kNotServing, pressing));
    EXPECT_EQ(health_of(server, "teletact.v1.Palpation"), kServing);
  }
  ASSERT_TRUE(becomes(server, kServing, pressing));
  EXPECT_TRUE(comes_to(pressing, v1::TOUCH_STATUS_OK));
}

}  // namespace
}  // namespace teletact::service
