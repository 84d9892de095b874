// The 1 kHz loop: read, render, limit, check finite, write. Nothing in it allocates, locks, logs or throws.
//
// Threads: tick()/run() on the servo thread. The link's thread puts answers and takes poses; any one other
// thread drains the telemetry; requests may come from any thread.
#pragma once

#include <atomic>
#include <cstdint>

#include "client/clock/clock.h"
#include "client/haptic/haptic_device.h"
#include "client/haptic/latest_slot.h"
#include "client/render/force_chain.h"
#include "client/render/renderer.h"
#include "client/servo/ring.h"
#include "client/servo/states.h"

namespace teletact::client {

// An answer as the link hands it to the servo.
struct ServoAnswer {
  ForceSample sample;
  bool has_force = true;         // false: the service could not compute one; the link is alive all the same
  bool covered = false;          // a window covers the pose
  bool degraded = false;         // the service says that its force is not to be trusted
  Region region = {};            // that is covered around it
  std::int64_t received_ns = 0;  // servo clock
  double period_s = 0;           // expected to the next: negotiated, or what the link has shown
  double round_trip_s = 0;       // of the link, smoothed; 0: not known
  double clock_offset_s = 0;     // the service's clock minus the servo's
  double modulus_time_s = 0;     // servo clock when the modulus under the finger came in; 0: not known
};

// The newest pose, for the link.
struct ServoPose {
  ToolPose pose;
  std::int64_t time_ns = 0;
  bool by_law = false;  // a contact law is rendered: answers only check it
};

// One tick, for telemetry and recordings.
struct ServoTick {
  std::int64_t time_ns = 0;  // when it woke and read the device
  ToolPose pose;
  Vector3 force_n = Vector3::Zero();  // written
  ServoState state = ServoState::kDisabled;
  StateReason reason = StateReason::kStart;
  std::uint64_t sequence = 0;  // of the pose behind the force; 0: there is no answer to render yet
  double lateness_s = 0;       // how late this tick woke
  double slack_s = 0;          // left of the last period when its work was done
  double silence_s = 0;
  double model_age_s = 0;
  double round_trip_s = 0;  // of the link, as the newest answer knew it
  double clock_offset_s = 0;
  double modulus_age_s = 0;  // since the modulus behind the newest answer came in; 0: not known
  double stiffness_n_m = 0;  // rendered along the push
  double stiffness_variance = 0;
  Vector2 lateral_stiffness_n_m = Vector2::Zero();  // both components
  Vector2 lateral_stiffness_variance = Vector2::Zero();
  double gain = 0;
  double energy_j = 0;       // the passivity observer's: < 0 was generated
  double stored_j = 0;       // held by the rendered model, as far as its force goes out
  double damping_n_s_m = 0;  // the passivity controller's
  bool device_ok = true;     // was read and written
  bool held_at_border = false;
  double balance_j = 0;                // may be given back in this contact (energy_ledger.h)
  EnergyLedger::Refused refused = {};  // the largest claim to energy that is refused, and what it lacks
  double withheld = 0;                 // share of the model's stiffness that is not paid for, 0 .. 1
  bool withholds = false;  // DEGRADED for that alone: much of it, for longer than a hand-over takes
  bool degraded = false;   // the chain trusts the force no longer and fades it, or much of it is withheld
  bool energy_generated = false;  // of these: for energy generated
  bool service_degraded =
      false;              // the service does not trust the answer behind the force; rendered all the same
  bool by_law = false;    // a contact law is rendered, not what answers tell
  bool faded = false;     // silence takes force away
  bool clutched = false;  // the clutch does, or gives it back
  const char* resume_refused = nullptr;  // asked for at this tick, and why it is ignored
};

struct ServoOptions {
  double period_s = 0.001;
  double overrun_s = 0.001;     // woken later than this is an overrun
  double clearance_m = 0.0005;  // out of contact: this far above the surface
  ForceChainOptions chain;
};

class ServoLoop {
 public:
  static constexpr std::size_t kTelemetryTicks = 8192;

  // Borrows all three; the device is open.
  ServoLoop(HapticDevice& device, Renderer& renderer, Clock& clock, const ServoOptions& options);

  // Ticks until `stop`, then slews the force to zero and writes it.
  void run(const std::atomic<bool>& stop) noexcept;
  // One tick that was due at `due_ns`.
  void tick(std::int64_t due_ns) noexcept;

  LatestSlot<ServoAnswer>& answers() noexcept { return answers_; }  // written by the link
  LatestSlot<NearLaw>& laws() noexcept { return laws_; }            // written by the link
  LatestSlot<ServoPose>& poses() noexcept { return poses_; }        // read by the link
  Ring<ServoTick, kTelemetryTicks>& telemetry() noexcept { return telemetry_; }
  const Ring<ServoTick, kTelemetryTicks>& telemetry() const noexcept { return telemetry_; }

  void request_resume() noexcept { resume_.store(true); }
  void request_pause() noexcept { pause_.store(true); }
  void request_disable() noexcept { disable_.store(true); }

  std::uint64_t ticks() const noexcept { return ticks_.load(std::memory_order_relaxed); }
  std::uint64_t overruns() const noexcept { return overruns_.load(std::memory_order_relaxed); }
  std::uint64_t rejected_answers() const noexcept { return rejected_.load(std::memory_order_relaxed); }

 private:
  bool read_device(std::int64_t now_ns) noexcept;
  void start_over() noexcept;
  void take_answer(std::int64_t now_ns) noexcept;
  ForceChainInput chain_input(const Rendered& rendered, std::int64_t now_ns) noexcept;
  StateInputs state_inputs(const ForceChainOutput& limited, bool device_ok) noexcept;
  void publish(const Rendered& rendered, const ForceChainOutput& limited, bool device_ok, std::int64_t now_ns,
               std::int64_t due_ns) noexcept;
  void show() noexcept;

  HapticDevice& device_;
  Renderer& renderer_;
  Clock& clock_;
  ServoOptions options_;
  ForceChain chain_;
  StateMachine states_;

  LatestSlot<ServoAnswer> answers_;
  LatestSlot<NearLaw> laws_;
  LatestSlot<ServoPose> poses_;
  Ring<ServoTick, kTelemetryTicks> telemetry_;
  std::atomic<bool> resume_{false};
  std::atomic<bool> pause_{false};
  std::atomic<bool> disable_{false};
  std::atomic<std::uint64_t> ticks_{0};
  std::atomic<std::uint64_t> overruns_{0};
  std::atomic<std::uint64_t> rejected_{0};

  DeviceReading reading_;  // the newest that the device gave in numbers
  ResumeButton button_;
  bool resume_pressed_ = false;  // by the button, at this tick
  const char* resume_refused_ = nullptr;
  bool finite_reading_ = true;
  ServoAnswer answer_;  // newest that arrived
  ServoAnswer incoming_;
  NearLaw law_;                  // newest that arrived
  bool by_law_ = false;          // a contact law is rendered
  double law_holds_s_ = 0;       // since when an answer said last that there is something to feel
  bool answered_ = false;        // any answer yet
  bool has_force_ = false;       // any with a force
  bool force_degraded_ = false;  // what the service says of the newest force
  std::uint64_t force_sequence_ = 0;
  double force_time_s_ = 0;  // of the pose behind the newest force
  double silence_s_ = 0;
  double model_age_s_ = 0;
  double last_slack_s_ = 0;
  std::int64_t last_ns_ = 0;
};

}  // namespace teletact::client
