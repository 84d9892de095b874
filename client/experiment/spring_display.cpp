#include "client/experiment/spring_display.h"

#include <cmath>
#include <stdexcept>

namespace teletact::client {
namespace {

constexpr double kPeriodS = 0.005;  // between answers
constexpr double kServoS = 0.001;

ServoOptions servo_options(const HapticDevice& device) {
  ServoOptions options;
  options.period_s = kServoS;
  options.chain.limits = device.profile().limits();
  return options;
}

}  // namespace

Rendered SpringRenderer::render(const ToolPose& pose, double, double) noexcept {
  const double indentation_m = pose.position_m.y();
  if (!(indentation_m > 0)) {
    shown_n_m_ = wanted_n_m_;
    return {};
  }
  Rendered rendered;
  rendered.force_n = {0, -shown_n_m_ * indentation_m};
  rendered.stiffness_n_m = shown_n_m_;
  return rendered;
}

SpringDisplay::SpringDisplay(HapticDevice& device, bool real_time)
    : device_(device),
      open_(device),
      servo_(std::make_unique<ServoLoop>(device, renderer_, clock_, servo_options(device))),
      thread_(std::make_unique<ServoThread>(*servo_, ServoThread::Options{.real_time = real_time})),
      answering_([this] { answer_poses(); }) {}

SpringDisplay::~SpringDisplay() {
  thread_.reset();  // the force goes first, while answers still come
  stop_ = true;
  answering_.join();
}

void SpringDisplay::require(double stiffness_n_m) const {
  const double most_n_m = device_.profile().limits().largest_stiffness_n_m;
  if (!(stiffness_n_m <= most_n_m))
    throw std::invalid_argument("stimuli_n_m: the device '" + device_.profile().name + "' shows at most " +
                                std::to_string(static_cast<int>(most_n_m)) +
                                " N/m, and a harder stimulus would be felt as that; give softer ones");
}

void SpringDisplay::present(double stiffness_n_m) {
  require(stiffness_n_m);
  renderer_.set(stiffness_n_m);
  servo_->request_pause();
  felt_ticks_ = 0;
}

bool SpringDisplay::felt() const noexcept {
  return felt_ticks_ * kServoS >= kFeltS;
}

std::string SpringDisplay::trouble() const {
  return state_ == ServoState::kEnabled ? "" : describe(reason_);
}

void SpringDisplay::answer_poses() {
  std::uint64_t sequence = 0;
  ServoPose pose;
  ServoAnswer answer;
  answer.covered = true;
  answer.covered_begin_m = -1e3;
  answer.covered_end_m = 1e3;
  answer.period_s = kPeriodS;
  while (!stop_) {
    if (servo_->poses().take(pose)) {
      answer.sample.sequence = ++sequence;
      answer.sample.pose_time_s = 1e-9 * static_cast<double>(pose.time_ns);
      answer.sample.position_m = pose.pose.position_m;
      answer.received_ns = clock_.now_ns();
      servo_->answers().put(answer);
    }
    drain();
    // Granted only out of contact: nobody needs a button to feel the next one. After a fault it takes the
    // person.
    if (state_ == ServoState::kEnabled) asked_ = false;
    if (state_ == ServoState::kDisabled || state_ == ServoState::kPaused || asked_) servo_->request_resume();
    clock_.sleep_until_ns(clock_.now_ns() + static_cast<std::int64_t>(1e9 * kPeriodS));
  }
}

void SpringDisplay::drain() {
  constexpr double kWholeShare = 0.9;  // of the force: past the start ramp, not faded
  ServoTick tick;
  while (servo_->telemetry().pop(tick)) {
    state_ = tick.state;
    reason_ = tick.reason;
    const double indentation_m = tick.pose.position_m.y(), wanted_n_m = renderer_.wanted_n_m();
    const bool whole = -tick.force_n.y() >= kWholeShare * wanted_n_m * indentation_m;
    if (tick.state == ServoState::kEnabled && indentation_m > kPressedM && tick.stiffness_n_m == wanted_n_m &&
        whole)
      ++felt_ticks_;
  }
}

}  // namespace teletact::client
