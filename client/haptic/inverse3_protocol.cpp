#include "client/haptic/inverse3_protocol.h"

#include <nlohmann/json.hpp>
#include <regex>
#include <stdexcept>

namespace teletact::client {
namespace {

using nlohmann::json;

Eigen::Vector3d vector_of(const json& state, const char* field) {
  const auto found = state.find(field);
  if (found == state.end() || !found->is_object())
    throw std::runtime_error(std::string("the Inverse3's state has no ") + field);
  Eigen::Vector3d out;
  const char* const axes[] = {"x", "y", "z"};
  for (int axis = 0; axis < 3; ++axis) {
    const auto value = found->find(axes[axis]);
    if (value == found->end() || !value->is_number())
      throw std::runtime_error(std::string("the Inverse3's ") + field + "." + axes[axis] +
                               " is not a number");
    out[axis] = value->get<double>();
  }
  return out;
}

// VerseGrip: "button": true; wireless: "buttons": {"a": true, ...}.
bool any_pressed(const json& message, const char* kind) {
  const auto grips = message.find(kind);
  if (grips == message.end() || !grips->is_array()) return false;
  for (const json& grip : *grips) {
    const auto state = grip.is_object() ? grip.find("state") : grip.end();
    if (state == grip.end() || !state->is_object()) continue;
    const auto button = state->find("button");
    if (button != state->end() && *button == true) return true;
    const auto buttons = state->find("buttons");
    if (buttons == state->end() || !buttons->is_object()) continue;
    for (const json& pressed : *buttons)
      if (pressed == true) return true;
  }
  return false;
}

// What is no unit quaternion is none: it is only looked at for whether it turns.
std::optional<Eigen::Vector4d> orientation_of(const json& message, const char* kind) {
  const auto grips = message.find(kind);
  if (grips == message.end() || !grips->is_array() || grips->empty()) return std::nullopt;
  const json::json_pointer where("/state/orientation");
  if (!grips->front().contains(where)) return std::nullopt;
  const json& at = grips->front().at(where);
  Eigen::Vector4d found = Eigen::Vector4d::Zero();
  const char* const parts[] = {"w", "x", "y", "z"};
  for (int part = 0; part < 4; ++part) {
    const auto value = at.find(parts[part]);
    if (value == at.end() || !value->is_number()) return std::nullopt;
    found[part] = value->get<double>();
  }
  const double size = found.norm();
  if (!(size > 0.5 && size < 2)) return std::nullopt;
  return found / size;
}

}  // namespace

Inverse3State parse_inverse3(const std::string& text) {
  const json message = json::parse(text, nullptr, false);
  if (!message.is_object()) throw std::runtime_error("a message of the Inverse Service is not a JSON object");
  const auto devices = message.find("inverse3");
  if (devices == message.end() || !devices->is_array() || devices->empty() || !devices->front().is_object())
    throw std::runtime_error("the Inverse Service knows no Inverse3: connect one and switch it on");
  const json& device = devices->front();
  const auto id = device.find("device_id"), state = device.find("state");
  if (id == device.end() || !id->is_string() || state == device.end() || !state->is_object())
    throw std::runtime_error("the Inverse Service sent an Inverse3 without device_id or state");
  Inverse3State out;
  out.device_id = id->get<std::string>();
  out.position_m = vector_of(*state, "cursor_position");
  out.velocity_m_s = vector_of(*state, "cursor_velocity");
  out.orientation = orientation_of(message, "verse_grip");
  if (!out.orientation) out.orientation = orientation_of(message, "wireless_verse_grip");
  out.pressed = any_pressed(message, "verse_grip") || any_pressed(message, "wireless_verse_grip");
  return out;
}

std::string inverse3_command(const std::string& device_id, const Eigen::Vector3d& force_n, bool first) {
  const json values = {{"x", force_n.x()}, {"y", force_n.y()}, {"z", force_n.z()}};
  const json device = {{"device_id", device_id}, {"commands", {{"set_cursor_force", {{"values", values}}}}}};
  json message = {{"inverse3", json::array({device})}};
  if (first) message["session"] = {{"configure", {{"profile", {{"name", "teletact"}}}}}};
  return message.dump();
}

WebSocketUrl parse_websocket_url(const std::string& url) {
  static const std::regex pattern(R"(ws://([^:/?#]+)(?::(\d{1,5}))?(/.*)?)");
  std::smatch match;
  if (!std::regex_match(url, match, pattern))
    throw std::invalid_argument("'" + url + "' is not a WebSocket address; give ws://HOST[:PORT][/PATH]");
  return {match[1], match[2].matched ? match[2].str() : "10001", match[3].matched ? match[3].str() : "/"};
}

}  // namespace teletact::client
