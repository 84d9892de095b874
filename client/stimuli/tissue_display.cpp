#include "client/stimuli/tissue_display.h"

#include <chrono>
#include <cmath>
#include <utility>

#include "client/clock/clock.h"
#include "client/render/renderers.h"

namespace teletact::client {
namespace {

constexpr double kServoS = 0.001;
constexpr double kWithheldMax = 0.02;  // of the force, while it counts as whole

ServoOptions servo_options(const HapticDevice& device) {
  ServoOptions options;
  options.period_s = kServoS;
  options.chain.limits = device.profile().limits();
  return options;
}

TouchLinkOptions link_options(const StimulusScenes& scenes, const std::string& scene_id,
                              const std::string& renderer, ServoLoop& servo) {
  TouchLinkOptions options;
  options.address = scenes.options().address;
  options.credentials = scenes.options().credentials;
  options.open = scenes.open(scene_id);
  if (renderer == "law") options.laws = &servo.laws();
  return options;
}

}  // namespace

// Destroyed in the opposite order: the force goes first, while the link still answers.
struct TissueDisplay::Interval {
  Interval(TissueDisplay& display, const std::string& scene_id)
      : options(servo_options(display.device_)),
        renderer(make_renderer(display.renderer_, kServoS, options.chain.limits)),
        servo(display.device_, *renderer, display.clock_, options),
        link(link_options(display.scenes_, scene_id, display.renderer_, servo), servo.poses(),
             servo.answers(), display.clock_),
        begun_ns(display.clock_.now_ns()),
        thread(servo, {.real_time = display.real_time_}) {
    link.start();
  }
  ServoOptions options;
  std::unique_ptr<Renderer> renderer;
  ServoLoop servo;
  TouchLink link;
  std::int64_t begun_ns;
  ServoThread thread;
};

TissueDisplay::TissueDisplay(HapticDevice& device, StimulusScenes& scenes, std::string renderer,
                             bool real_time)
    : device_(device),
      scenes_(scenes),
      renderer_(std::move(renderer)),
      real_time_(real_time),
      open_((make_renderer(renderer_, kServoS), device)),
      watching_([this] { watch(); }) {}

TissueDisplay::~TissueDisplay() {
  stop_ = true;
  watching_.join();
  interval_.reset();
}

void TissueDisplay::present(double stiffness_n_m, double) {
  const std::string& scene_id = scenes_.scene_of(stiffness_n_m);
  std::unique_ptr<Interval> before;
  bool was_lost = false;
  {
    const std::lock_guard lock(mutex_);
    before = std::move(interval_);
    was_lost = !lost_.empty();
    felt_ = {};
    after_fault_ = after_fault_ || newest_.state == ServoState::kFault;
    newest_ = {};
    answered_ns_ = enabled_ns_ = 0;
  }
  before.reset();  // which takes the force away
  if (was_lost) scenes_.make_sure();
  auto next = std::make_unique<Interval>(*this, scene_id);
  const std::lock_guard lock(mutex_);
  lost_.clear();
  interval_ = std::move(next);
}

bool TissueDisplay::felt() const noexcept {
  const std::lock_guard lock(mutex_);
  return felt_.felt(kServoS);
}

double TissueDisplay::felt_n_m() const {
  const std::lock_guard lock(mutex_);
  return felt_.mean_n_m();
}

std::string TissueDisplay::trouble() const {
  const std::lock_guard lock(mutex_);
  if (!interval_ || answered_ns_ == 0) return "the service does not answer yet";
  if (newest_.state != ServoState::kEnabled) return describe(newest_.reason);
  return interval_->link.covered() ? "" : "the finger is beside the tissue";
}

std::string TissueDisplay::lost() const {
  const std::lock_guard lock(mutex_);
  return lost_;
}

void TissueDisplay::watch() {
  while (!stop_) {
    {
      const std::lock_guard lock(mutex_);
      if (interval_) look(*interval_);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

void TissueDisplay::look(Interval& interval) {
  ServoTick tick;
  while (interval.servo.telemetry().pop(tick)) count(tick);
  if (lost_.empty()) {
    std::string why = interval.link.failure();
    if (why.empty()) why = interval.link.trouble();
    const bool silent = answered_ns_ == 0 && seconds(clock_.now_ns() - interval.begun_ns) > kOpenS;
    if (why.empty() && silent) why = "it does not answer";
    if (!why.empty()) lost_ = "the service was lost (" + why + ")";
  }
  if (lost_.empty())
    ask_for_resume(interval.servo);
  else
    interval.servo.request_disable();
}

void TissueDisplay::count(const ServoTick& tick) {
  newest_ = tick;
  if (tick.silence_s < kOpenS && answered_ns_ == 0) answered_ns_ = tick.time_ns;
  if (tick.state != ServoState::kEnabled) {
    enabled_ns_ = 0;
    return;
  }
  if (enabled_ns_ == 0) enabled_ns_ = tick.time_ns;
  after_fault_ = asked_ = false;
  const double ramp_s = ForceChainOptions().start_ramp_s;
  const bool whole = seconds(tick.time_ns - enabled_ns_) >= ramp_s && tick.sequence > 0 && !tick.faded &&
                     !tick.degraded && !tick.clutched && tick.withheld <= kWithheldMax;
  const Vector3& tool_m = tick.pose.position_m;
  const Vector3 from_middle_m = tool_m - scenes_.middle_m();
  const double width_m = scenes_.options().place.width_m;
  const bool there = width_m <= 0 || std::hypot(from_middle_m.x(), from_middle_m.z()) <= width_m / 2;
  if (!whole || !there || !lost_.empty() || tool_m.y() <= kPressedM) return;
  felt_.add(-tick.force_n.y(), tool_m.y());
}

// Granted only out of contact: nobody needs a button to feel the next one. After a fault it takes the person.
void TissueDisplay::ask_for_resume(ServoLoop& servo) {
  constexpr double kLawS = 1;  // a law is waited for, where one may come
  const bool off = newest_.state == ServoState::kDisabled || newest_.state == ServoState::kPaused;
  const bool known = answered_ns_ > 0 && (renderer_ != "law" || newest_.by_law ||
                                          seconds(newest_.time_ns - answered_ns_) > kLawS);
  if (known && ((off && !after_fault_) || asked_)) servo.request_resume();
}

}  // namespace teletact::client
