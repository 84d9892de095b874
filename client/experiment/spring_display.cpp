#include "client/experiment/spring_display.h"

#include <cmath>
#include <stdexcept>

#include "client/render/kalman_renderer.h"

namespace teletact::client {
namespace {

constexpr double kPerfectPeriodS = 0.005;  // between answers that nothing waits for
constexpr double kServoS = 0.001;

std::unique_ptr<Renderer> renderer_of(const std::optional<SpringChain>& chain) {
  if (!chain) return nullptr;
  validate(*chain);
  KalmanOptions options;
  options.blend.servo_period_s = kServoS;
  return std::make_unique<KalmanRenderer>(options);
}

// Without zeros behind the point.
std::string number(double value) {
  std::string text = std::to_string(value);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

const SpringPlace& checked(const SpringPlace& place) {
  validate(place);
  return place;
}

SpringAnswers answers_of(const std::optional<SpringChain>& chain) {
  return chain ? SpringAnswers(1 / chain->update_hz, chain->age_s) : SpringAnswers(kPerfectPeriodS, 0);
}

ServoOptions servo_options(const HapticDevice& device) {
  ServoOptions options;
  options.period_s = kServoS;
  options.chain.limits = device.profile().limits();
  return options;
}

}  // namespace

std::string condition_of(const std::optional<SpringChain>& chain, const SpringPlace& place) {
  std::string text = kPerfectStiffness;
  if (chain)
    text = "kalman at " + number(chain->update_hz) + " Hz " + number(1e3 * chain->age_s) + " ms late";
  if (place.width_m > 0)
    text += " on an inclusion of " + number(1e3 * place.width_m) + " mm with edges of " +
            number(1e3 * place.edge_m) + " mm";
  return text;
}

void validate(const SpringChain& chain) {
  if (!(chain.update_hz >= 1 && chain.update_hz <= 1000))
    throw std::invalid_argument("update_hz: give 1 to 1000 answers a second");
  if (!(chain.age_s >= 0 && chain.age_s <= 0.3))
    throw std::invalid_argument("age_s: give 0 to 0.3 s; of what is older the force is taken away");
}

void validate(const SpringPlace& place) {
  if (place.width_m != 0 && !(place.width_m >= 0.01 && place.width_m <= 0.05))
    throw std::invalid_argument("width_m: give an inclusion of 0.01 to 0.05 m, or 0 for none");
  if (!(place.edge_m >= 0.0005 && place.edge_m <= 0.005))
    throw std::invalid_argument("edge_m: give 0.0005 to 0.005 m");
}

void require_shown(const DeviceProfile& profile, double stiffness_n_m) {
  const double max_n_m = profile.limits().largest_stiffness_n_m;
  if (!(stiffness_n_m <= max_n_m))
    throw std::invalid_argument("stimuli_n_m: the device '" + profile.name + "' shows at most " +
                                std::to_string(static_cast<int>(max_n_m)) +
                                " N/m, and a harder stimulus would be felt as that; give softer ones");
}

Rendered PerfectRenderer::render(const ToolPose& pose, double, EnergyLedger&) noexcept {
  Rendered rendered;
  rendered.variance = 0;
  rendered.lateral_variance.setZero();
  const ForceSample exact = tissue_.answer(pose.position_m);
  if (!exact.contact) return rendered;
  rendered.force_n = exact.force_n;
  rendered.stiffness_n_m = -exact.force_n.y() / pose.position_m.y();
  rendered.lateral_stiffness_n_m.x() = -exact.force_n.x() / pose.position_m.y();
  return rendered;
}

SpringDisplay::SpringDisplay(HapticDevice& device, bool real_time, const std::optional<SpringChain>& chain,
                             const SpringPlace& place)
    : device_(device),
      open_(device),
      place_(checked(place)),
      renderer_(renderer_of(chain)),
      servo_(std::make_unique<ServoLoop>(device, renderer_ ? *renderer_ : perfect_, clock_,
                                         servo_options(device))),
      answers_(answers_of(chain)),
      thread_(std::make_unique<ServoThread>(*servo_, ServoThread::Options{.real_time = real_time})),
      answering_([this] { answer_poses(); }) {}

SpringDisplay::~SpringDisplay() {
  thread_.reset();  // the force goes first, while answers still come
  stop_ = true;
  answering_.join();
}

void SpringDisplay::present(double stiffness_n_m, double background_n_m) {
  require(stiffness_n_m);
  require(background_n_m);
  SpringTissue tissue{.background_n_m = background_n_m, .stimulus_n_m = stiffness_n_m};
  if (has_inclusion()) {
    tissue.centre_m = kInclusionCentreM;
    tissue.half_width_m = place_.width_m / 2;
    tissue.edge_m = place_.edge_m;
  }
  const std::lock_guard lock(mutex_);
  answers_.present(tissue);
  servo_->request_pause();
  felt_ = {};
}

bool SpringDisplay::felt() const noexcept {
  const std::lock_guard lock(mutex_);
  return felt_.felt(kServoS);
}

double SpringDisplay::felt_n_m() const {
  const std::lock_guard lock(mutex_);
  return felt_.mean_n_m();
}

std::string SpringDisplay::trouble() const {
  return state_ == ServoState::kEnabled ? "" : describe(reason_);
}

void SpringDisplay::answer_poses() {
  const auto known = static_cast<unsigned>(KalmanOptions().outliers_in_a_row);  // by then the filter has it
  ServoPose pose;
  while (!stop_) {
    {
      const std::lock_guard lock(mutex_);
      if (servo_->poses().take(pose)) answers_.add(pose);
      if (const std::optional<ServoAnswer> answer = answers_.take(clock_.now_ns())) {
        perfect_.set_tissue(answers_.shown());
        servo_->answers().put(*answer);
      }
      drain();
      // Granted only out of contact: nobody needs a button to feel the next one. After a fault it takes the
      // person.
      if (state_ == ServoState::kEnabled) asked_ = false;
      const bool wanted = state_ == ServoState::kDisabled || state_ == ServoState::kPaused || asked_;
      if (wanted && answers_.arrived() >= known) servo_->request_resume();
    }
    clock_.sleep_until_ns(clock_.now_ns() + static_cast<std::int64_t>(1e9 * kServoS));
  }
}

void SpringDisplay::drain() {
  constexpr double kWholeShare = 0.9;  // of the force: past the start ramp, not faded
  ServoTick tick;
  while (servo_->telemetry().pop(tick)) {
    state_ = tick.state;
    reason_ = tick.reason;
    const Vector3& tool_m = tick.pose.position_m;
    const SpringTissue& tissue = answers_.shown();
    const bool there = std::abs(tool_m.x() - tissue.centre_m) <= tissue.half_width_m;
    const bool whole = -tick.force_n.y() >= -kWholeShare * tissue.answer(tool_m).force_n.y();
    if (tick.state == ServoState::kEnabled && tool_m.y() > kPressedM && there && whole &&
        answers_.is_presented(tick.sequence))
      felt_.add(-tick.force_n.y(), tool_m.y());
  }
}

}  // namespace teletact::client
