#include "client/session/devices.h"

#include <stdexcept>
#include <vector>

#include "client/clock/clock.h"
#include "client/haptic/inverse3_device.h"
#include "client/haptic/plugin_device.h"
#include "client/haptic/replay_device.h"
#include "client/haptic/simulated_device.h"
#include "client/haptic/simulated_position_device.h"
#include "client/link/recording.h"
#include "client/link/servo_messages.h"
#include "client/servo/states.h"

namespace teletact::client {
namespace {

// The motion of a touch recording, from the tick on at which force was first on: out of contact.
std::vector<MotionPoint> read_motion(const std::string& path) {
  RecordReader reader(path);
  std::vector<MotionPoint> motion;
  while (const auto entry = reader.next()) {
    if (!entry->has_servo()) continue;
    const v1::ServoSample& sample = entry->servo();
    if (motion.empty() && sample.state() != static_cast<std::uint32_t>(ServoState::kEnabled)) continue;
    const auto position_m = vector_from(sample.position_m()),
               velocity_m_s = vector_from(sample.velocity_m_s());
    if (!position_m || !velocity_m_s)
      throw std::runtime_error("recording '" + path + "': a servo tick without a position");
    MotionPoint point;
    point.time_s = seconds(entry->monotonic_ns());
    point.pose = {*position_m, *velocity_m_s};
    if (motion.empty() || point.time_s > motion.back().time_s) motion.push_back(point);
  }
  if (motion.size() < 2)
    throw std::runtime_error("recording '" + path +
                             "' holds no motion with force on; record one with 'touch --record FILE'");
  return motion;
}

Vector3 start_of(const DeviceChoice& choice) {
  return {choice.hand.start_m, -choice.hand.hover_m, choice.hand.across_m};
}

std::unique_ptr<HapticDevice> make_unmapped(const DeviceChoice& choice) {
  const std::string kind = choice.device.substr(0, choice.device.find(':'));
  const std::string rest = kind.size() < choice.device.size() ? choice.device.substr(kind.size() + 1) : "";
  if (kind == "simulated" && rest.empty()) {
    SimulatedDeviceOptions options;
    options.profile = device_profile(choice.profile);
    options.hand = choice.hand;
    return std::make_unique<SimulatedDevice>(options);
  }
  if (kind == "simulated-position" && rest.empty()) {
    SimulatedPositionDeviceOptions options;
    options.profile = device_profile(choice.profile);
    options.hand = choice.hand;
    return std::make_unique<SimulatedPositionDevice>(options);
  }
  if (kind == "replay" && !rest.empty())
    return std::make_unique<ReplayDevice>(device_profile(choice.profile), read_motion(rest));
  if (kind == "plugin" && !rest.empty()) {
    const std::size_t comma = rest.find(',');
    const std::string settings = comma == std::string::npos ? "" : rest.substr(comma + 1);
    return std::make_unique<PluginDevice>(rest.substr(0, comma), settings, start_of(choice));
  }
  if (kind == "inverse3") {
    Inverse3Options options;
    if (!rest.empty()) options.url = rest;
    options.start_m = start_of(choice);
    return std::make_unique<Inverse3Device>(options);
  }
  throw std::invalid_argument(
      "unknown device '" + choice.device +
      "'; known: simulated, plugin:FILE[,SETTINGS], inverse3[:URL], replay:FILE, simulated-position");
}

}  // namespace

bool is_real(const std::string& device) {
  return device.rfind("plugin:", 0) == 0 || device.rfind("inverse3", 0) == 0;
}

std::unique_ptr<WorkspaceDevice> make_real_device(const DeviceChoice& choice) {
  return std::make_unique<WorkspaceDevice>(make_unmapped(choice), choice.workspace, start_of(choice));
}

std::unique_ptr<HapticDevice> make_device(const DeviceChoice& choice) {
  if (is_real(choice.device)) return make_real_device(choice);
  return make_unmapped(choice);
}

}  // namespace teletact::client
