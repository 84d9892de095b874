#include "client/servo/states.h"

namespace teletact::client {

const char* name(ServoState state) noexcept {
  switch (state) {
    case ServoState::kDisabled:
      return "DISABLED";
    case ServoState::kEnabled:
      return "ENABLED";
    case ServoState::kPaused:
      return "PAUSED";
    case ServoState::kFault:
      return "FAULT";
  }
  return "?";
}

const char* describe(StateReason reason) noexcept {
  switch (reason) {
    case StateReason::kStart:
      return "not started yet";
    case StateReason::kResumed:
      return "resumed by the operator, out of contact";
    case StateReason::kSilence:
      return "no answer from the service: force faded to zero; lift the finger and resume";
    case StateReason::kPausedByUser:
      return "paused by the operator";
    case StateReason::kDisabledByUser:
      return "disabled by the operator";
    case StateReason::kDeviceLost:
      return "the device could not be read or written, or states no position yet: check its cable and power";
    case StateReason::kNotFinite:
      return "a force or position was not a number";
    case StateReason::kTooFast:
      return "the device moved faster than its speed limit";
    case StateReason::kFrozen:
      return "the device's position is frozen: it stands still, to the last bit, while the hand does not; "
             "lift the finger, see to the device, and resume when it follows the hand again";
  }
  return "?";
}

const char* refusal_of_resume(const StateInputs& in) noexcept {
  if (!in.device_ok || !in.finite) return "the device is not read";
  if (in.frozen) return "the device's position is frozen";
  if (in.too_fast) return "the device moves too fast";
  if (!in.link_alive) return "no answer comes from the service";
  if (!in.out_of_contact) return "the finger is in the tissue; lift it";
  return nullptr;
}

bool StateMachine::become(ServoState state, StateReason reason, std::int64_t now_ns) noexcept {
  if (state == state_ && reason == reason_) return false;
  state_ = state;
  reason_ = reason;
  since_ns_ = now_ns;
  return true;
}

bool StateMachine::step(const StateInputs& in, std::int64_t now_ns) noexcept {
  if (!in.device_ok) return become(ServoState::kFault, StateReason::kDeviceLost, now_ns);
  if (!in.finite) return become(ServoState::kFault, StateReason::kNotFinite, now_ns);
  if (in.frozen) return become(ServoState::kFault, StateReason::kFrozen, now_ns);
  if (state_ == ServoState::kEnabled && in.too_fast) {
    return become(ServoState::kFault, StateReason::kTooFast, now_ns);
  }
  if (in.disable) return become(ServoState::kDisabled, StateReason::kDisabledByUser, now_ns);
  if (state_ == ServoState::kEnabled) {
    if (in.silence_is_zero) return become(ServoState::kPaused, StateReason::kSilence, now_ns);
    if (in.pause) return become(ServoState::kPaused, StateReason::kPausedByUser, now_ns);
    return false;
  }
  if (in.resume && !in.pause && !refusal_of_resume(in))
    return become(ServoState::kEnabled, StateReason::kResumed, now_ns);
  return false;
}

}  // namespace teletact::client
