// States of the servo, named as CRTK names them, and the one place that decides on changes.
//
//   DISABLED --resume--> ENABLED --silence, pause--> PAUSED --resume--> ENABLED
//   any --device lost, frozen, runaway, no number--> FAULT --resume--> ENABLED
//
// A resume is granted only out of contact, with answers flowing and nothing wrong at that very tick; one that
// is not granted is forgotten, never kept for later: force may not come back as a surprise.
#pragma once

#include <cstdint>

namespace teletact::client {

enum class ServoState : std::uint32_t { kDisabled = 0, kEnabled = 1, kPaused = 2, kFault = 3 };

enum class StateReason : std::uint32_t {
  kStart = 0,
  kResumed,
  kSilence,  // no answer for so long that the force is zero
  kPausedByUser,
  kDisabledByUser,
  kDeviceLost,  // could not be read or written
  kNotFinite,   // the rendered force or the device's position was no number
  kTooFast,     // the device ran away
  kFrozen,      // its position is not of now
};

const char* name(ServoState) noexcept;
const char* describe(StateReason) noexcept;

// What a tick has seen.
struct StateInputs {
  bool device_ok = true;
  bool finite = true;
  bool too_fast = false;
  bool frozen = false;
  bool link_alive = false;      // the last answer is younger than the silence that starts to fade
  bool silence_is_zero = true;  // silence has faded the force to nothing
  bool out_of_contact = false;
  bool resume = false;  // asked for at this tick
  bool pause = false;
  bool disable = false;
};

// Why a resume is not granted at this tick; null: it may be.
const char* refusal_of_resume(const StateInputs&) noexcept;

// A button asks when it goes down. One that is down when it is first seen, or seen again, has to be let go
// first: neither a held nor a stuck one brings force back.
class ResumeButton {
 public:
  bool asks(bool down) noexcept {
    const bool asked = down && !was_down_;
    was_down_ = down;
    return asked;
  }
  void unseen() noexcept { was_down_ = true; }

 private:
  bool was_down_ = true;
};

class StateMachine {
 public:
  ServoState state() const noexcept { return state_; }
  StateReason reason() const noexcept { return reason_; }
  std::int64_t since_ns() const noexcept { return since_ns_; }
  // True when the state changed.
  bool step(const StateInputs& inputs, std::int64_t now_ns) noexcept;

 private:
  bool become(ServoState state, StateReason reason, std::int64_t now_ns) noexcept;
  ServoState state_ = ServoState::kDisabled;
  StateReason reason_ = StateReason::kStart;
  std::int64_t since_ns_ = 0;
};

}  // namespace teletact::client
