#include "client/haptic/inverse3_device.h"

#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <memory>
#include <thread>

#include "client/haptic/inverse3_protocol.h"
#include "tests/haptic/inverse3_service.h"

namespace teletact::client {
namespace {

using test::Inverse3Service;

bool within(double seconds, const std::function<bool()>& met) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (std::chrono::steady_clock::now() < end) {
    if (met()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return met();
}

Inverse3Options options_for(const Inverse3Service& service) {
  return {.url = service.url(), .start_m = {0.04, -0.005, 0}, .open_wait_s = 2};
}

std::string complaint(const Inverse3Options& options) {
  try {
    Inverse3Device device(options);
    device.open();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

TEST(Inverse3Protocol, ReadsTheFirstDeviceAndItsGrip) {
  const Inverse3State state = parse_inverse3(
      R"({"session_id": 7, "inverse3": [{"device_id": "04BA", "state": {
          "cursor_position": {"x": 0.078, "y": -0.148, "z": 0.143},
          "cursor_velocity": {"x": -0.01, "y": 0.001, "z": -1}}, "status": {"ready": true}}],
          "verse_grip": [{"device_id": "61548", "state": {"button": true, "hall": 0,
          "orientation": {"w": 0.6, "x": 0, "y": -0.8, "z": 0}}}]})");
  EXPECT_EQ(state.device_id, "04BA");
  EXPECT_EQ(state.position_m, Eigen::Vector3d(0.078, -0.148, 0.143));
  EXPECT_EQ(state.velocity_m_s, Eigen::Vector3d(-0.01, 0.001, -1));
  EXPECT_TRUE(state.pressed);
  ASSERT_TRUE(state.orientation);
  EXPECT_LE((*state.orientation - Eigen::Vector4d(0.6, 0, -0.8, 0)).norm(), 1e-12);
}

TEST(Inverse3Protocol, AnOrientationThatIsNoneIsLeftOut) {
  for (const char* grips :
       {"[]", "[null]", "3", R"([{"state": 3}])", R"([{"state": {"orientation": [1, 0, 0, 0]}}])",
        R"([{"state": {"orientation": {"w": 1, "x": 0, "y": 0}}}])",
        R"([{"state": {"orientation": {"w": 0, "x": 0, "y": 0, "z": 0}}}])"})
    EXPECT_FALSE(parse_inverse3(std::string(R"({"inverse3": [{"device_id": "a", "state": {"cursor_position":
        {"x": 1, "y": 0, "z": 0}, "cursor_velocity": {"x": 0, "y": 0, "z": 0}}}], "verse_grip": )") +
                                grips + "}")
                     .orientation)
        << grips;
}

TEST(Inverse3Protocol, RefusesWhatIsNoState) {
  for (const char* text :
       {"", "no json", "[]", "{}", R"({"inverse3": []})", R"({"inverse3": [3]})",
        R"({"inverse3": [{"device_id": 5, "state": {}}]})", R"({"inverse3": [{"device_id": "a"}]})",
        R"({"inverse3": [{"device_id": "a", "state": {"cursor_position": {"x": 0, "y": 0, "z": null},
            "cursor_velocity": {"x": 0, "y": 0, "z": 0}}}]})",
        R"({"inverse3": [{"device_id": "a", "state": {"cursor_position": {"x": 0, "y": 0, "z": 0}}}],
            "verse_grip": [null, {"state": 3}], "wireless_verse_grip": {"buttons": true}})"}) {
    EXPECT_THROW(parse_inverse3(text), std::runtime_error) << text;
  }
}

TEST(Inverse3Protocol, ReadsAddresses) {
  EXPECT_EQ(parse_websocket_url("ws://localhost").port, "10001");
  const WebSocketUrl url = parse_websocket_url("ws://10.0.0.7:9000/a/b");
  EXPECT_EQ(url.host + " " + url.port + " " + url.path, "10.0.0.7 9000 /a/b");
  for (const char* text : {"", "localhost:10001", "http://x", "ws://", "ws://h:port"})
    EXPECT_THROW(parse_websocket_url(text), std::invalid_argument) << text;
}

TEST(Inverse3Device, TurnsCursorAndForceBetweenAxes) {
  Inverse3Service service;
  service.put_cursor({0.01, -0.12, 0.15}, {0, 0, 0});
  Inverse3Device device(options_for(service));
  device.open();
  DeviceReading reading;
  // GIVEN where it stands at first THEN that is the start above the tissue
  ASSERT_TRUE(device.read(0, reading));
  EXPECT_EQ(reading.pose.position_m, Vector3(0.04, -0.005, 0));
  EXPECT_FALSE(reading.resume_pressed);
  // WHEN it moves 2 mm to the right and 7 mm down and 30 mm forward
  service.put_cursor({0.012, -0.09, 0.143}, {0.1, 0.5, -0.2});
  service.pressed = true;
  ASSERT_TRUE(within(2, [&] { return device.read(0, reading) && reading.resume_pressed; }));
  EXPECT_NEAR(reading.pose.position_m.x(), 0.042, 1e-12);
  EXPECT_NEAR(reading.pose.position_m.y(), 0.002, 1e-12);
  EXPECT_NEAR(reading.pose.position_m.z(), 0.03, 1e-12);
  EXPECT_NEAR(reading.pose.velocity_m_s.x(), 0.1, 1e-12);
  EXPECT_NEAR(reading.pose.velocity_m_s.y(), 0.2, 1e-12);
  EXPECT_NEAR(reading.pose.velocity_m_s.z(), 0.5, 1e-12);
  // THEN a force that lifts the finger (scene -y) is one upwards
  EXPECT_TRUE(within(2, [&] {
    device.read(0, reading);
    device.write({0.3, -1.5, 0.2});
    return service.force_n() == Eigen::Vector3d(0.3, 0.2, 1.5);
  }));
  EXPECT_EQ(service.first_command().at("session").at("configure").at("profile").at("name"), "teletact");
  EXPECT_FALSE(device.write({NAN, 0, 0}));
}

TEST(Inverse3Device, AForceThatIsNotRenewedAndOneAtTheEndAreZero) {
  Inverse3Service service;
  Inverse3Device device(options_for(service));
  device.open();
  DeviceReading reading;
  const auto push = [&] {
    device.read(0, reading);
    device.write({0, -2, 0});
    return service.force_n().z() == 2;
  };
  ASSERT_TRUE(within(2, push));
  // WHEN the servo hangs THEN the force is gone after 10 ms
  EXPECT_TRUE(within(1, [&] { return service.force_n().norm() == 0; }));
  ASSERT_TRUE(within(2, push));
  device.close();
  EXPECT_EQ(service.force_n().norm(), 0);
}

// The servo goes on asking for 2 N whatever the device says.
TEST(Inverse3Device, LostOrGarbledServiceIsToldZeroFirst) {
  auto service = std::make_unique<Inverse3Service>();
  Inverse3Device device(options_for(*service));
  device.open();
  DeviceReading reading;
  const auto push = [&] {
    device.read(0, reading);
    device.write({0, -2, 0});
    return service->force_n().z() == 2;
  };
  const auto pushed_to_zero = [&] { return !push() && service->force_n().norm() == 0; };
  ASSERT_TRUE(within(5, push));
  // WHEN it takes what it is told and says nothing THEN it is told zero
  const unsigned before = service->connections;
  service->silent = true;
  EXPECT_TRUE(within(5, pushed_to_zero));
  EXPECT_EQ(service->connections, before) << "zero came before it counted as lost";
  service->silent = false;
  ASSERT_TRUE(within(5, push));
  // WHEN it talks nonsense THEN zero is the last that it is told
  service->garbage = true;
  EXPECT_TRUE(within(5, pushed_to_zero));
  const unsigned connections = service->connections;
  EXPECT_TRUE(within(5, [&] {
    push();
    return service->connections > connections;
  }));
  // THEN zero is the first that it is told on each connection
  service->garbage = false;
  EXPECT_TRUE(within(5, push));
  EXPECT_EQ(service->largest_first_n(), 0);
  device.let_go();
  EXPECT_FALSE(device.write({0, -2, 0}));
  EXPECT_TRUE(within(1, [&] { return service->force_n().norm() == 0; }));
}

TEST(Inverse3Device, ALostServiceIsALostDeviceAndIsFoundAgain) {
  auto service = std::make_unique<Inverse3Service>();
  const int port = service->port;
  Inverse3Device device(options_for(*service));
  device.open();
  DeviceReading reading;
  ASSERT_TRUE(device.read(0, reading));
  service.reset();
  EXPECT_TRUE(within(1, [&] { return !device.read(0, reading); }));
  service = std::make_unique<Inverse3Service>(port);
  EXPECT_TRUE(within(3, [&] { return device.read(0, reading); }));
  // A service that hangs is as lost as one that is gone; so is one that talks nonsense.
  service->silent = true;
  EXPECT_TRUE(within(1, [&] { return !device.read(0, reading); }));
  service->silent = false;
  EXPECT_TRUE(within(3, [&] { return device.read(0, reading); }));
  service->garbage = true;
  EXPECT_TRUE(within(1, [&] { return !device.read(0, reading); }));
  service->garbage = false;
  EXPECT_TRUE(within(3, [&] { return device.read(0, reading); }));
  EXPECT_GE(service->connections, 3u);
}

// GIVEN a service that has not heard of its device yet WHEN it has THEN the session begins there, and also on
// a later connection the finger never was where it was not.
TEST(Inverse3Device, HasNoPositionBeforeItsDeviceSpeaks) {
  auto service = std::make_unique<Inverse3Service>(0, Eigen::Vector3d::Zero());
  const int port = service->port;
  Inverse3Options options = options_for(*service);
  options.open_wait_s = 0.3;
  EXPECT_NE(complaint(options).find("it states no position yet"), std::string::npos) << complaint(options);
  options.open_wait_s = 30;
  const Eigen::Vector3d stands_m(0.01, -0.12, 0.15);
  const unsigned before = service->messages;
  std::thread speaks([&] {
    within(30, [&] { return service->messages > before + 20; });
    service->put_cursor(stands_m, {0, 0, 0});
  });
  Inverse3Device device(options);
  device.open();
  DeviceReading reading;
  speaks.join();
  const unsigned spoken = service->messages;
  EXPECT_TRUE(within(30, [&] { return service->messages > spoken + 20; }));
  ASSERT_TRUE(device.read(0, reading));
  EXPECT_EQ(reading.pose.position_m, Vector3(0.04, -0.005, 0));
  service.reset();
  EXPECT_TRUE(within(30, [&] { return !device.read(0, reading); }));
  service = std::make_unique<Inverse3Service>(port, Eigen::Vector3d::Zero());
  EXPECT_TRUE(within(30, [&] {
    EXPECT_TRUE(device.write({0, -2, 0}));
    EXPECT_FALSE(device.read(0, reading));
    return service->messages > 50;
  }));
  EXPECT_EQ(service->force_n().norm(), 0);
  service->put_cursor(stands_m, {0, 0, 0});
  EXPECT_TRUE(within(30, [&] { return device.read(0, reading); }));
  EXPECT_EQ(reading.pose.position_m, Vector3(0.04, -0.005, 0));
}

TEST(Inverse3Device, SaysWhatIsWrong) {
  const std::string nobody = complaint({.url = "ws://127.0.0.1:1", .open_wait_s = 0.3});
  EXPECT_NE(nobody.find("no Inverse3 at ws://127.0.0.1:1: Connection refused"), std::string::npos) << nobody;
  EXPECT_NE(nobody.find("start the Haply Inverse Service"), std::string::npos) << nobody;
  Inverse3Service service;
  service.has_device = false;
  Inverse3Options options = options_for(service);
  options.open_wait_s = 0.3;
  EXPECT_NE(complaint(options).find("knows no Inverse3: connect one"), std::string::npos)
      << complaint(options);
  EXPECT_NE(complaint({.url = "spoon"}).find("'spoon' is not a WebSocket address"), std::string::npos);
}

}  // namespace
}  // namespace teletact::client
