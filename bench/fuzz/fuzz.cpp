#include "bench/fuzz/fuzz.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>

#include "bench/fuzz/laws.h"
#include "bench/fuzz/source.h"
#include "bench/stability/renderers.h"
#include "bench/stability/servo_period.h"
#include "bench/stability/tissue.h"
#include "client/link/servo_messages.h"

namespace teletact::bench {
namespace {

using client::Vector3;

constexpr std::size_t kSessionTicks = 4000;
constexpr double kSurfaceM = 0;
constexpr double kHandOver = 0.01;  // of the answers: another window, under the finger

// A finger that presses, slides, along and across, and lifts.
class Finger {
 public:
  explicit Finger(Source& source)
      : depth_m_(source.between(0.001, 0.009)),
        press_1_s_(2 * M_PI / source.logarithmic(0.4, 4)),
        slide_1_s_(source.between(1, 6)) {}
  client::ToolPose at(double time_s) const {
    constexpr double kHoverM = 0.002, kWayM = 0.025, kAcrossM = 0.01;
    const double press = press_1_s_ * time_s, slide = slide_1_s_ * time_s;
    client::ToolPose pose;
    pose.position_m = {0.06 + kWayM * std::sin(slide),
                       kSurfaceM - kHoverM + (depth_m_ + kHoverM) / 2 * (1 - std::cos(press)),
                       kAcrossM * std::cos(slide)};
    pose.velocity_m_s = {kWayM * slide_1_s_ * std::cos(slide),
                         (depth_m_ + kHoverM) / 2 * press_1_s_ * std::sin(press),
                         -kAcrossM * slide_1_s_ * std::sin(slide)};
    return pose;
  }

 private:
  double depth_m_, press_1_s_, slide_1_s_;
};

class FuzzDevice final : public client::HapticDevice {
 public:
  // Some state friction, some damping, some neither.
  explicit FuzzDevice(Source& source) {
    if (source.one_of(2) == 0) profile_.friction_n = 0;
    if (source.one_of(2) == 0) profile_.damping_n_s_m = source.between(0, 5);
  }
  const client::DeviceProfile& profile() const noexcept override { return profile_; }
  void open() override {}
  void close() noexcept override {}
  bool read(std::int64_t, client::DeviceReading& reading) noexcept override {
    if (readable) reading = next;
    return readable;
  }
  bool write(const Vector3& n) noexcept override {
    force_n = n;
    return writable;
  }
  void show(const client::OperatorView& shown) noexcept override { view = shown; }
  client::DeviceReading next;
  client::OperatorView view;
  bool readable = true, writable = true;
  Vector3 force_n = Vector3::Zero();

 private:
  client::DeviceProfile profile_ = client::device_profile("omni");
};

void set_vector(const Vector3& value, google::protobuf::RepeatedField<double>* xyz) {
  xyz->Clear();
  for (const double number : value) xyz->Add(number);
}

template <class Message>
void set_force(const client::ForceSample& sample, Message* out) {
  set_vector(sample.force_n, out->mutable_force_n());
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) out->add_tangent_n_m(sample.tangent_n_m(row, column));
}

v1::TouchAnswer honest_answer(const StabilityTissue& tissue, const Vector3& position_m, double pose_time_s,
                              std::uint64_t sequence, std::uint64_t version) {
  v1::TouchAnswer answer;
  answer.set_sequence(sequence);
  answer.set_model_version(version);
  answer.mutable_pose_stamp()->set_monotonic_ns(std::llround(1e9 * pose_time_s));
  answer.set_status(v1::TOUCH_STATUS_OK);
  set_vector(position_m, answer.mutable_position_m());
  set_force(tissue.answer(position_m), &answer);
  const client::ForceSample told = tissue.told(position_m);
  if (told.foreseen) {
    set_vector(told.position_m, answer.mutable_foreseen()->mutable_position_m());
    set_force(told, answer.mutable_foreseen());
  }
  answer.mutable_covered()->set_end_x_m(0.12);
  return answer;
}

void spoil_numbers(Source& source, google::protobuf::RepeatedField<double>* values) {
  switch (source.one_of(4)) {
    case 0:  // too few
      values->Truncate(static_cast<int>(source.one_of(static_cast<std::uint64_t>(values->size()) + 1)));
      break;
    case 1:
      values->Add(source.wild());
      break;
    case 2:  // a jump
      for (double& value : *values) value *= source.logarithmic(0.01, 100) * (source.one_of(2) == 0 ? 1 : -1);
      break;
    default:
      for (double& value : *values)
        if (source.one_of(2) == 0) value = source.wild();
  }
}

// One thing wrong with it.
void spoil(Source& source, v1::TouchAnswer& answer) {
  switch (source.one_of(8)) {
    case 0:
      return spoil_numbers(source, answer.mutable_position_m());
    case 6:
      return answer.set_model_version(source.one_of(20));
    case 5: {
      v1::ForeseenTouch& foreseen = *answer.mutable_foreseen();  // in contact too, where none belongs
      return spoil_numbers(source, source.happens(0.3)   ? foreseen.mutable_position_m()
                                   : source.happens(0.5) ? foreseen.mutable_force_n()
                                                         : foreseen.mutable_tangent_n_m());
    }
    case 1:
      return spoil_numbers(source, answer.mutable_force_n());
    case 2:
      return spoil_numbers(source, answer.mutable_tangent_n_m());
    case 3:  // out of order, twice, or far ahead of what was asked
      answer.set_sequence(source.happens(0.01) ? std::numeric_limits<std::uint64_t>::max()
                                               : answer.sequence() - source.one_of(50) + source.one_of(30));
      return;
    case 4: {  // stale, or from the future
      const std::int64_t second_ns = 1'000'000'000;
      const std::int64_t off_ns = std::llround(source.between(-2, 0.5) * double(second_ns));
      answer.mutable_pose_stamp()->set_monotonic_ns(source.happens(0.1)
                                                        ? std::numeric_limits<std::int64_t>::min()
                                                        : answer.pose_stamp().monotonic_ns() + off_ns);
      return;
    }
    default:
      answer.set_status(static_cast<v1::TouchStatus>(source.one_of(7)));
  }
}

// One thing wrong with what the device says.
void spoil(Source& source, FuzzDevice& device) {
  client::ToolPose& pose = device.next.pose;
  switch (source.one_of(5)) {
    case 0:
      device.readable = false;
      break;
    case 1:
      device.writable = false;
      break;
    case 2:
      pose.position_m = {source.wild(), source.wild(), source.wild()};
      break;
    case 3:
      pose.velocity_m_s = {source.wild(), source.wild(), source.wild()};
      break;
    default:  // jumps although it says that it rests
      pose.position_m +=
          Vector3(source.between(-0.05, 0.05), source.between(-0.02, 0.02), source.between(-0.05, 0.05));
      pose.velocity_m_s.setZero();
  }
}

StabilityTissue some_tissue(Source& source) {
  return {source.one_of(2) == 0 ? Scene::kHomogeneous : Scene::kInclusions, source.logarithmic(50, 5000)};
}

// One touch session of a few seconds: servo loop, renderer, device, and the answers that reach it.
class Session {
 public:
  Session(Source& source, const std::string& renderer)
      : source_(source),
        finger_(source),
        tissue_(some_tissue(source)),
        device_(source),
        renderer_(make_any_renderer(renderer, kServoS, device_.profile().limits())),
        period_s_(source.logarithmic(0.001, 0.05)),
        late_s_(source.happens(0.7) ? source.between(0, 0.02) : source.between(0, 0.3)),
        hostile_answers_(source.one_of(4) == 0 ? 0 : source.logarithmic(0.01, 0.7)),
        hostile_readings_(source.one_of(3) == 0 ? 0 : source.logarithmic(1e-4, 1e-3)),
        laws_(source, source.one_of(4) == 0 ? 0 : source.logarithmic(0.01, 0.7)) {
    client::ServoOptions options;
    options.chain.limits = device_.profile().limits();
    limits_ = options.chain.limits;
    longest_dt_s_ = options.chain.longest_dt_s;
    loop_ = std::make_unique<client::ServoLoop>(device_, *renderer_, clock_, options);
  }

  void tick(FuzzResult& result, FuzzShares& shares) {
    const std::int64_t before_ns = clock_.time_ns;
    const bool late = source_.happens(1e-3);
    clock_.time_ns += late ? std::llround(source_.between(0, 0.1) * 1e9) : kServoNs;
    read(shares);
    answer(shares);
    if (shares.renderer == "law")
      if (const auto law = laws_.next(tissue_, version_, device_.next.pose.position_m.x(), shares))
        loop_->laws().put(*law);
    if (source_.happens(1e-4)) loop_->request_pause();
    loop_->tick(clock_.time_ns);
    const client::ServoState before = tick_.state;
    loop_->telemetry().pop(tick_);
    // The first tick slews for the servo's own period: it has none to measure.
    const double passed_s = ticks_++ == 0 ? kServoS : 1e-9 * double(clock_.time_ns - before_ns);
    check(std::min(passed_s, longest_dt_s_), before == client::ServoState::kEnabled, result, shares);
  }

 private:
  double now_s() const { return 1e-9 * double(clock_.time_ns); }

  void read(FuzzShares& shares) {
    device_.readable = device_.writable = true;
    device_.next.pose = finger_.at(now_s() - kStartS);
    device_.next.resume_pressed = source_.one_of(50) == 0;
    if (burst_ > 0) --burst_;
    if (source_.happens(hostile_readings_)) burst_ = 1 + source_.one_of(20);
    if (burst_ == 0) return;
    spoil(source_, device_);
    ++shares.hostile_readings;
    no_number_ = no_number_ || (device_.readable && !device_.next.pose.position_m.allFinite());
  }

  void answer(FuzzShares& shares) {
    if (source_.happens(2e-4)) next_s_ = now_s() + source_.between(0, 1.5);  // the link is gone
    if (now_s() < next_s_) return;
    next_s_ = now_s() + period_s_ * source_.between(0.5, 1.5);
    if (source_.happens(kHandOver)) tissue_ = some_tissue(source_), ++version_;
    const double pose_s = std::max(now_s() - late_s_ - kServoS, kStartS);
    v1::TouchAnswer answer =
        honest_answer(tissue_, finger_.at(pose_s - kStartS).position_m, pose_s, sequence_ += 20, version_);
    if (source_.happens(hostile_answers_)) {
      spoil(source_, answer);
      ++shares.hostile_answers;
    }
    ++shares.answers;
    // What the stream was opened with may be as hostile.
    const auto surface = client::surface_from(some_layer());
    const double period_s = source_.happens(1e-3) ? source_.wild() : period_s_;
    if (!surface) return;  // the link refuses such a stream
    if (const auto converted = client::to_servo_answer(answer, *surface, period_s, clock_.time_ns))
      loop_->answers().put(*converted);
  }

  // Level, or now and then anywhere and anyhow.
  v1::Layer some_layer() {
    v1::Layer layer;
    layer.set_depth_m(source_.happens(1e-4) ? source_.wild() : kSurfaceM);
    if (!source_.happens(2e-4)) return layer;
    Vector3 normal(source_.wild(), source_.wild(), source_.wild());
    if (source_.one_of(2) == 0)
      normal = Vector3(source_.between(-1, 1), 1, source_.between(-1, 1)).normalized();
    for (const double component : normal) layer.add_normal(component);
    return layer;
  }

  void check(double dt_s, bool enabled, FuzzResult& result, FuzzShares& shares) {
    constexpr double kRounding = 1e-12, kSilentS = 0.5;
    const Vector3& force_n = device_.force_n;
    const double depth_m = std::max(device_.view.surface.depth_m(tick_.pose.position_m), 0.0);
    const double way_m = device_.view.surface.normal.dot(tick_.pose.position_m - last_m_);
    const double pressed_m = std::min(std::max(0.0, way_m), depth_m);
    const double step_n = (force_n - last_n_).norm();
    const double max_n = limits_.largest_slew_n_s * dt_s + limits_.largest_stiffness_n_m * pressed_m;
    const bool silent = tick_.silence_s > kSilentS, grows = force_n.norm() > last_n_.norm();
    ++result.cases;
    if (!force_n.allFinite()) ++result.not_finite;
    if (!(force_n.norm() <= limits_.largest_force_n * (1 + kRounding))) ++result.too_large;
    // To where the last force may have fallen, in the circle on it (Thales), and from there by the slew and
    // as the finger presses in.
    if (!((force_n - last_n_ / 2).norm() <= last_n_.norm() / 2 + max_n + kRounding)) ++result.too_fast;
    if (!(force_n.norm() <= limits_.largest_stiffness_n_m * depth_m * (1 + kRounding))) ++result.above_cap;
    if (!enabled && grows) ++result.grown;
    if (silent && force_n.norm() > 0) ++result.in_silence;
    ++shares.cases;
    shares.by_law += tick_.by_law && force_n.norm() > 0;
    if (!(tick_.balance_j >= -kRounding)) ++result.overdrawn;
    shares.fading += !enabled && force_n.norm() > 0;
    shares.silent += silent;
    shares.non_zero += force_n.norm() > 0;
    shares.after_no_number += no_number_;
    shares.non_zero_after += no_number_ && force_n.norm() > 0;
    shares.slew_limited += dt_s > 0 && grows && step_n >= max_n * (1 - 1e-9);
    // A law's potential goes on straight a little below.
    shares.at_largest += force_n.norm() >= limits_.largest_force_n * (tick_.by_law ? 0.93 : 1 - 1e-9);
    last_n_ = force_n;
    last_m_ = tick_.pose.position_m;
  }

  static constexpr double kStartS = 1;  // the manual clock's
  Source& source_;
  Finger finger_;
  StabilityTissue tissue_;
  FuzzDevice device_;
  client::ManualClock clock_;
  std::unique_ptr<client::Renderer> renderer_;
  std::unique_ptr<client::ServoLoop> loop_;
  client::ForceLimits limits_;
  double longest_dt_s_ = 0;
  double period_s_, late_s_, hostile_answers_, hostile_readings_;
  FuzzLaws laws_;
  double next_s_ = 0;
  std::uint64_t version_ = 1;
  std::uint64_t sequence_ = 100, ticks_ = 0;
  std::uint64_t burst_ = 0;  // ticks that are hostile still
  bool no_number_ = false;
  Vector3 last_n_ = Vector3::Zero();
  Vector3 last_m_ = Vector3::Constant(std::numeric_limits<double>::quiet_NaN());  // none yet
  client::ServoTick tick_;
};

}  // namespace

FuzzResult fuzz_forces(std::size_t cases, std::uint64_t seed) {
  Source source(seed);
  FuzzResult result;
  result.renderers.push_back({.renderer = "law"});
  for (const std::string& name : renderer_names()) result.renderers.push_back({.renderer = name});
  for (std::size_t number = 0; result.cases < cases; ++number) {
    // Every other session by law, which has the most to be hostile with.
    const std::size_t others = result.renderers.size() - 1;
    FuzzShares& shares = result.renderers[number % 2 == 0 ? 0 : 1 + number / 2 % others];
    Session session(source, shares.renderer);
    for (std::size_t n = 0; n < kSessionTicks && result.cases < cases; ++n) session.tick(result, shares);
  }
  return result;
}

}  // namespace teletact::bench
