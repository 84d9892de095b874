// The JSON that the Haply Inverse Service speaks over its WebSocket (version 3.1 and later; the maker's
// "Simulation Channel" and "WebSocket Protocol" pages).
//
// On connecting the service sends an inventory of all devices; after that exactly one state message for each
// message that it gets. Haply's axes: x right, y forward, z up; metres, m/s, newtons.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

namespace teletact::client {

struct Inverse3State {
  std::string device_id;
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_m_s = Eigen::Vector3d::Zero();
  std::optional<Eigen::Vector4d> orientation;  // of the first grip that states one, a unit quaternion
  bool pressed = false;                        // any button of any grip
};

// The first Inverse3 of a message. Throws std::runtime_error, saying what is missing: no JSON, no device, no
// position.
Inverse3State parse_inverse3(const std::string& message);

// A force on the cursor of that device. The first message of a connection also says who we are.
std::string inverse3_command(const std::string& device_id, const Eigen::Vector3d& force_n, bool first);

struct WebSocketUrl {
  std::string host, port, path;
};
// "ws://host[:port][/path]"; port 10001 when absent. Throws std::invalid_argument.
WebSocketUrl parse_websocket_url(const std::string& url);

}  // namespace teletact::client
