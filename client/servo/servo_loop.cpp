#include "client/servo/servo_loop.h"

#include <algorithm>
#include <cmath>

#include "client/clock/clock.h"

namespace teletact::client {
namespace {

// Silence and age before anything has arrived: longer than any limit.
constexpr double kForeverS = 1e9;

}  // namespace

ServoLoop::ServoLoop(HapticDevice& device, Renderer& renderer, Clock& clock, const ServoOptions& options)
    : device_(device), renderer_(renderer), clock_(clock), options_(options), chain_(options.chain) {}

void ServoLoop::run(const std::atomic<bool>& stop) noexcept {
  const auto period_ns = static_cast<std::int64_t>(std::llround(options_.period_s * 1e9));
  std::int64_t due_ns = clock_.now_ns() + period_ns;
  while (true) {
    clock_.sleep_until_ns(due_ns);
    tick(due_ns);
    if (stop.load(std::memory_order_relaxed)) {
      request_disable();
      if (states_.state() != ServoState::kEnabled && chain_.last_force_n().norm() == 0) break;
    }
    const std::int64_t done_ns = clock_.now_ns();
    due_ns += period_ns;
    last_slack_s_ = seconds(due_ns - done_ns);
    // Ticks that are past are not made up for: the device wants the newest force, not each of them.
    while (due_ns < done_ns) due_ns += period_ns;
  }
}

void ServoLoop::tick(std::int64_t due_ns) noexcept {
  const std::int64_t now_ns = clock_.now_ns();
  // read
  bool device_ok = read_device(now_ns);
  poses_.put({reading_.pose, now_ns, by_law_});
  take_answer(now_ns);
  if (laws_.take(law_)) renderer_.take_law(law_);
  // render
  const Rendered rendered = renderer_.render(reading_.pose, seconds(now_ns), chain_.ledger());
  by_law_ = rendered.by_law;
  // limit, and check finite
  const ForceChainOutput limited = chain_.apply(chain_input(rendered, now_ns));
  // write
  device_ok = device_.write(limited.force_n) && device_ok;
  const StateInputs inputs = state_inputs(limited, device_ok);
  if (states_.step(inputs, now_ns) && states_.state() == ServoState::kFault) start_over();
  resume_refused_ =
      inputs.resume && states_.state() != ServoState::kEnabled ? refusal_of_resume(inputs) : nullptr;
  publish(rendered, limited, device_ok, now_ns, due_ns);
  show();
  last_ns_ = now_ns;
}

// A pose that is no number stays with the device: neither model nor link ever sees one.
bool ServoLoop::read_device(std::int64_t now_ns) noexcept {
  DeviceReading fresh;
  const bool answered = device_.read(now_ns, fresh);
  finite_reading_ = !answered || (fresh.pose.position_m.allFinite() && fresh.pose.velocity_m_s.allFinite());
  resume_pressed_ = false;
  if (answered && finite_reading_) {
    reading_ = fresh;
    resume_pressed_ = button_.asks(fresh.resume_pressed);
  } else {
    reading_.pose.velocity_m_s.setZero();
    reading_.unseen.velocity_m_s.setZero();
    button_.unseen();
  }
  return answered;
}

// After a fault nothing is rendered of what was known before.
void ServoLoop::start_over() noexcept {
  renderer_.reset();
  has_force_ = false;
  force_sequence_ = 0;
}

void ServoLoop::take_answer(std::int64_t now_ns) noexcept {
  if (answers_.take(incoming_)) {
    const bool in_order = !answered_ || incoming_.sample.sequence > answer_.sample.sequence;
    const bool from_past = incoming_.sample.pose_time_s <= seconds(now_ns);
    if (is_finite(incoming_.sample) && in_order && from_past) {
      answer_ = incoming_;
      answered_ = true;
      if (answer_.has_force) {
        force_degraded_ = answer_.degraded;
        if (answer_.covered) law_holds_s_ = seconds(answer_.received_ns);
        if (renderer_.update(answer_.sample, reading_.pose, seconds(now_ns))) {
          has_force_ = true;
          force_sequence_ = answer_.sample.sequence;
          force_time_s_ = answer_.sample.pose_time_s;
        }
      }
    } else {
      rejected_.fetch_add(1, std::memory_order_relaxed);
    }
  }
  silence_s_ = answered_ ? seconds(now_ns - answer_.received_ns) : kForeverS;
  model_age_s_ = has_force_ ? seconds(now_ns) - force_time_s_ : kForeverS;
}

ForceChainInput ServoLoop::chain_input(const Rendered& rendered, std::int64_t now_ns) noexcept {
  ForceChainInput input;
  input.rendered = rendered;
  input.pose = reading_.pose;
  input.unseen = reading_.unseen;
  input.clutched = reading_.clutched;
  input.surface = answer_.sample.surface;
  input.on = states_.state() == ServoState::kEnabled;
  input.frozen = states_.reason() == StateReason::kFrozen;
  input.enabled_s = seconds(now_ns - states_.since_ns());
  input.silence_s = silence_s_;
  // A law is as old as what says that it still holds, an answer with a force, was when the newest came: that
  // none comes is silence.
  input.model_age_s = by_law_ ? seconds(answer_.received_ns) - law_holds_s_ : model_age_s_;
  input.period_s = answer_.period_s;
  input.dt_s = last_ns_ == 0 ? options_.period_s : seconds(now_ns - last_ns_);
  return input;
}

StateInputs ServoLoop::state_inputs(const ForceChainOutput& limited, bool device_ok) noexcept {
  StateInputs inputs;
  inputs.device_ok = device_ok;
  inputs.finite = finite_reading_ && !limited.not_finite;
  inputs.too_fast = limited.too_fast;
  inputs.frozen = reading_.frozen;
  inputs.link_alive = silence_s_ <= silence_limits(answer_.period_s, by_law_).fade_s;
  inputs.silence_is_zero = limited.silence_gain <= 0;
  inputs.out_of_contact = answer_.sample.surface.depth_m(reading_.pose.position_m) < -options_.clearance_m;
  inputs.resume = resume_.exchange(false) || resume_pressed_;
  inputs.pause = pause_.exchange(false);
  inputs.disable = disable_.exchange(false);
  return inputs;
}

void ServoLoop::publish(const Rendered& rendered, const ForceChainOutput& limited, bool device_ok,
                        std::int64_t now_ns, std::int64_t due_ns) noexcept {
  ServoTick tick;
  tick.time_ns = now_ns;
  tick.pose = reading_.pose;
  tick.force_n = limited.force_n;
  tick.state = states_.state();
  tick.reason = states_.reason();
  tick.sequence = force_sequence_;
  tick.lateness_s = seconds(tick.time_ns - due_ns);
  tick.slack_s = last_slack_s_;
  tick.silence_s = silence_s_;
  tick.model_age_s = model_age_s_;
  tick.round_trip_s = answer_.round_trip_s;
  tick.clock_offset_s = answer_.clock_offset_s;
  tick.modulus_age_s = answer_.modulus_time_s > 0 ? seconds(now_ns) - answer_.modulus_time_s : 0;
  tick.stiffness_n_m = rendered.stiffness_n_m;
  tick.stiffness_variance = rendered.variance;
  tick.lateral_stiffness_n_m = rendered.lateral_stiffness_n_m;
  tick.lateral_stiffness_variance = rendered.lateral_variance;
  tick.gain = rendered.gain;
  tick.energy_j = limited.energy_j;
  tick.stored_j = limited.stored_j;
  tick.damping_n_s_m = limited.damping_n_s_m;
  tick.device_ok = device_ok;
  tick.held_at_border = reading_.held_at_border;
  tick.balance_j = limited.balance_j;
  tick.refused = limited.refused;
  tick.withheld = limited.withheld;
  tick.withholds = limited.withholds && !limited.fades;
  tick.degraded = limited.degraded;
  tick.energy_generated = limited.energy_generated;
  tick.service_degraded = force_degraded_;
  tick.by_law = by_law_;
  tick.faded = limited.silence_gain < 1;
  tick.clutched = limited.clutch_gain < 1;
  tick.resume_refused = resume_refused_;
  ticks_.fetch_add(1, std::memory_order_relaxed);
  if (tick.lateness_s > options_.overrun_s) overruns_.fetch_add(1, std::memory_order_relaxed);
  telemetry_.push(tick);
}

void ServoLoop::show() noexcept {
  OperatorView view;
  view.force_on = states_.state() == ServoState::kEnabled;
  view.link_alive = silence_s_ <= silence_limits(answer_.period_s, by_law_).fade_s;
  view.covered = answered_ && answer_.covered;
  view.region = answer_.region;
  view.surface = answer_.sample.surface;
  device_.show(view);
}

}  // namespace teletact::client
