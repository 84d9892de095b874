#include "bench/stability/rig.h"

#include <algorithm>
#include <cmath>

#include "bench/stability/renderers.h"
#include "bench/stability/servo_period.h"
#include "client/haptic/simulated_device.h"

namespace teletact::bench {

using client::ForceSample;
using client::ToolPose;

Sensor::Sensor(double resolution_m, const Vector3& start_m)
    : exact_(resolution_m <= 0), reading_(resolution_m, client::SimulatedDeviceOptions().velocity_filter_s) {
  reading_.restart(start_m);
}

ToolPose Sensor::read(const ToolPose& exact) noexcept {
  if (exact_) return exact;
  reading_.take(exact.position_m, kServoS);
  return reading_.pose();
}

// The plant behind the product's device interface: what the servo writes is felt from then on.
class Controller::Device final : public client::HapticDevice {
 public:
  explicit Device(const client::DeviceProfile& profile) : profile_(profile) {}
  const client::DeviceProfile& profile() const noexcept override { return profile_; }
  void open() override {}
  void close() noexcept override {}
  bool read(std::int64_t, client::DeviceReading& out) noexcept override {
    out = reading;
    return true;
  }
  bool write(const Vector3& n) noexcept override {
    force_n = n;
    return true;
  }
  client::DeviceReading reading;
  Vector3 force_n = Vector3::Zero();

 private:
  client::DeviceProfile profile_;
};

Controller::Controller(const RigOptions& options)
    : options_(options),
      renderer_(make_any_renderer(options.renderer, kServoS, options.profile.limits())),
      device_(std::make_unique<Device>(options.profile)) {
  if (!options.safe) return;
  client::ServoOptions servo;
  servo.chain.limits = options.profile.limits();
  loop_ = std::make_unique<client::ServoLoop>(*device_, *renderer_, clock_, servo);
}

Controller::~Controller() = default;

Vector3 Controller::tick(const ToolPose& pose, const ForceSample* answer, double time_s) noexcept {
  if (!options_.safe) {
    if (answer != nullptr) renderer_->update(*answer, pose, time_s);
    return renderer_->render(pose, time_s).force_n;
  }
  if (answer != nullptr) {
    client::ServoAnswer incoming;
    incoming.sample = *answer;
    incoming.sample.pose_time_s += kStartS;
    incoming.covered = true;
    incoming.received_ns = clock_.time_ns;
    incoming.period_s = options_.update_s;
    loop_->answers().put(incoming);
  }
  device_->reading.pose = pose;
  device_->reading.resume_pressed = time_s < options_.asks_until_s && clock_.time_ns / kServoNs % 20 >= 10;
  loop_->tick(clock_.time_ns);
  clock_.time_ns += kServoNs;
  loop_->telemetry().pop(last_);
  return device_->force_n;
}

void Controller::take_law(const client::NearLaw& law) noexcept {
  if (options_.safe) {
    loop_->laws().put(law);
  } else {
    renderer_->take_law(law);
  }
}

Answers::Answers(const StabilityTissue& tissue, const RigOptions& options)
    : tissue_(&tissue),
      every_(std::max<std::size_t>(static_cast<std::size_t>(std::lround(options.update_s / kServoS)), 1)),
      late_(static_cast<std::size_t>(std::lround(options.model_delay_s / kServoS))),
      stall_(static_cast<std::size_t>(std::lround(options.stall_s / kServoS))),
      foreseen_(options.foreseen) {}

const ForceSample* Answers::at(std::size_t tick, const ToolPose& pose) {
  if (tick % every_ == 0) {
    ForceSample& sample = waiting_[asked_ % waiting_.size()];
    sample = foreseen_ ? tissue_->told(pose.position_m) : tissue_->answer(pose.position_m);
    sample.sequence = ++asked_;
    sample.model_version = version_;
    sample.pose_time_s = kServoS * static_cast<double>(tick);
  }
  if (tick < late_ || (tick - late_) % every_ != 0) return nullptr;
  newest_ = waiting_[given_++ % waiting_.size()];
  constexpr std::size_t kStalled = 10, kOnes = 5;  // in the sixth of ten
  return stall_ > 0 && tick / stall_ % kStalled == kOnes ? nullptr : &newest_;
}

}  // namespace teletact::bench
