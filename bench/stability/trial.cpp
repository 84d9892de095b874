#include "bench/stability/trial.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "bench/stability/path.h"
#include "bench/stability/rig.h"
#include "bench/stability/servo_period.h"

namespace teletact::bench {
namespace {

using client::ForceSample;
using client::ToolPose;

std::size_t ticks_of(double seconds) {
  return static_cast<std::size_t>(std::lround(seconds / kServoS));
}

RigOptions rig_of(const TrialOptions& options) {
  client::DeviceProfile profile = options.device;
  profile.damping_n_s_m = options.damping_known ? options.damping_n_s_m : 0;
  return {options.renderer, profile,           options.update_s, options.model_delay_s,
          options.foreseen, HandPath::kHoverS, options.stall_s,  options.safe};
}

// Squares of the force error of what was written and of two exact models of the same age.
struct ForceErrors {
  double truth = 0, felt = 0, law = 0, tangent = 0;
  void add(const StabilityTissue& tissue, const Plant& plant, const ToolPose& read, const ForceSample& newest,
           const Vector3& written_n) {
    const Vector3 truth_n = tissue.force_n(plant.position_m());
    const Vector3 law_n = tissue.force_n({newest.position_m.x(), read.position_m.y(), 0});
    const Vector3 tangent_n = newest.force_n + newest.tangent_n_m * (read.position_m - newest.position_m);
    truth += truth_n.squaredNorm();
    felt += (written_n - truth_n).squaredNorm();
    law += (law_n - truth_n).squaredNorm();
    tangent += (tangent_n - truth_n).squaredNorm();
  }
  double relative(double squares) const { return truth > 0 ? std::sqrt(squares / truth) : 0; }
};

// Energy of the port beyond what the tissue stores at the place: it may only grow, by what is dissipated.
class Drawdown {
 public:
  void add(const StabilityTissue& tissue, const Plant& plant) {
    const double stored_j = tissue.energy_j(plant.position_m());
    const double beyond_j = plant.port_energy_j() - stored_j;
    highest_j_ = std::max(highest_j_, beyond_j);
    worst_j_ = std::max(worst_j_, highest_j_ - beyond_j);
    stored_j_ = std::max(stored_j_, stored_j);
  }
  double share() const { return stored_j_ > 0 ? worst_j_ / stored_j_ : 0; }

 private:
  double highest_j_ = 0, worst_j_ = 0, stored_j_ = 0;
};

// What a law's renderer is to display (T7.3), of the exact energy; below the display's largest force.
struct Displayed {
  double energy_j = 0;
  Vector3 force_n = Vector3::Zero();
};
Displayed displayed(const StabilityTissue& tissue, double largest_n_m, const Vector3& position_m) {
  constexpr double kSharp = 8, kBelow = 0.94;
  const double d = position_m.y(), u = tissue.energy_j(position_m), k = kBelow * largest_n_m;
  if (!(d > 0)) return {};
  const double s = k * d * d / 2, phi = std::pow(std::pow(u, -kSharp) + std::pow(s, -kSharp), -1 / kSharp);
  const double of_u = std::pow(phi / u, kSharp + 1), of_s = std::pow(phi / s, kSharp + 1);
  return {phi, of_u * tissue.force_n(position_m) - of_s * Vector3(0, k * d, 0)};
}

// A law that is felt against the exact one.
class LawErrors {
 public:
  explicit LawErrors(const TrialOptions& options)
      : largest_n_m_(options.device.largest_stiffness_n_m),
        tangent_n_m_(std::min(options.stiffness_n_m, largest_n_m_)),
        resolution_m_(options.device.resolution_m),
        capped_(options.stiffness_n_m > kLawWithinCap * largest_n_m_) {}
  void add(const StabilityTissue& tissue, const ToolPose& read, const Vector3& written_n) {
    if (!(read.position_m.y() > 0)) return;
    constexpr double kFastMS = 0.15, kFloorN = 0.001;
    ++contact_;
    if (read.velocity_m_s.norm() > kFastMS) return;
    const Vector3 exact_n =
        capped_ ? displayed(tissue, largest_n_m_, read.position_m).force_n : tissue.force_n(read.position_m);
    const double off_n = (written_n - exact_n).norm() - kFloorN;
    ++judged_;
    half_ += off_n <= 0.005 * exact_n.norm();
    one_ += off_n <= 0.01 * exact_n.norm();
  }
  // From here to there under that force.
  void moved(const StabilityTissue& tissue, const Vector3& from_m, const Vector3& to_m,
             const Vector3& force_n) {
    const double way_m = (to_m - from_m).norm();
    put_in_j_ += tangent_n_m_ * way_m * (way_m + resolution_m_) / 2 - force_n.dot(to_m - from_m);
    const double held_j = displayed(tissue, largest_n_m_, to_m).energy_j;
    max_j_ = std::max(max_j_, put_in_j_ - held_j);
    given_j_ = std::max(given_j_, max_j_ - (put_in_j_ - held_j));
    held_j_ = std::max(held_j_, held_j);
  }
  void finish(TrialResult& result) const {
    const double judged = std::max(judged_, 1.0);
    result.within_half = half_ / judged;
    result.within_one = one_ / judged;
    result.fast_share = 1 - judged_ / std::max(contact_, 1.0);
    result.given = held_j_ > 0 ? given_j_ / held_j_ : 0;
  }

 private:
  double largest_n_m_, tangent_n_m_, resolution_m_;
  bool capped_;
  double contact_ = 0, judged_ = 0, half_ = 0, one_ = 0;
  double put_in_j_ = 0, max_j_ = 0, given_j_ = 0, held_j_ = 0;
};

constexpr double kLostM = 0.05;  // this far from where it should be, nothing is left to simulate

RestOptions rest_of(const TrialOptions& options) {
  return {.update_s = options.update_s,
          .delay_s = options.force_delay_s + options.model_delay_s,
          .min_s = options.rest_s,
          .unfelt_m = 3 * options.device.resolution_m + 3e-5};
}

void count_safety(const Controller& controller, TrialResult& result) {
  if (controller.last().state != client::ServoState::kEnabled) return;
  ++result.enabled_share;
  if (controller.last().degraded) ++result.degraded_share;
  if (controller.last().damping_n_s_m > 0) ++result.damping_share;
}

void finish(const ForceErrors& errors, const Drawdown& drawdown, TrialResult& result) {
  result.drawdown = drawdown.share();
  result.force_error = errors.relative(errors.felt);
  result.exact_law_error = errors.relative(errors.law);
  result.exact_tangent_error = errors.relative(errors.tangent);
  const double after_start =
      static_cast<double>(result.ticks - std::min(result.ticks, ticks_of(HandPath::kHoverS)));
  const double enabled = std::max(result.enabled_share, 1.0);
  result.degraded_share /= enabled;
  result.damping_share /= enabled;
  result.enabled_share /= std::max(after_start, 1.0);
}

}  // namespace

const std::vector<HandProfile>& hands() {
  static const std::vector<HandProfile> all{{"middle", 0.1, 5, 500},
                                            {"light, loose, soft", 0.01, 2, 200},
                                            {"light, loose, stiff", 0.01, 2, 1000},
                                            {"light, damped, soft", 0.01, 10, 200},
                                            {"light, damped, stiff", 0.01, 10, 1000},
                                            {"heavy, loose, soft", 0.2, 2, 200},
                                            {"heavy, loose, stiff", 0.2, 2, 1000},
                                            {"heavy, damped, soft", 0.2, 10, 200},
                                            {"heavy, damped, stiff", 0.2, 10, 1000}};
  return all;
}

const HandProfile& hand(const std::string& name) {
  for (const HandProfile& one : hands())
    if (one.name == name) return one;
  throw std::out_of_range("no hand " + name);
}

client::DeviceProfile ideal_display() {
  constexpr double kNone = 1e6;
  return {"ideal", 1e3, kNone, 5, 1, 0, 0, 0, 0};
}

TrialResult run_trial(const TrialOptions& options) {
  const StabilityTissue tissue(options.scene, options.stiffness_n_m);
  RestWatch rest(rest_of(options));
  const HandPath path(options, tissue.background_n_m());
  Plant plant({.mass_kg = options.device.apparent_mass_kg + options.hand.mass_kg,
               .damping_n_s_m = options.damping_n_s_m,
               .friction_n = options.device.friction_n,
               .hand_stiffness_n_m = options.hand.stiffness_n_m,
               .hand_damping_n_s_m = options.hand.damping_n_s_m,
               .step_s = kServoS},
              HandPath::start_m());
  Sensor sensor(options.device.resolution_m, HandPath::start_m());
  const RigOptions rig = rig_of(options);
  Controller controller(rig);
  Answers answers(tissue, rig);
  std::array<Vector3, kLongestDelayTicks> written_n;
  written_n.fill(Vector3::Zero());
  const std::size_t ticks = ticks_of(path.stopped_s() + rest.length_s());
  const std::size_t late = ticks_of(options.force_delay_s);
  ForceErrors errors;
  LawErrors law_errors(options);
  Drawdown drawdown;
  TrialResult result;
  if (options.renderer == "law") controller.take_law(tissue.law(1, options.law_end_m));
  const double lost_m = kLostM + options.stiffness_n_m * options.indentation_m / options.hand.stiffness_n_m;
  bool lost = false;
  for (std::size_t tick = 0; tick < ticks && !lost && !rest.settled(); ++tick, ++result.ticks) {
    const double time_s = kServoS * static_cast<double>(tick);
    const ToolPose pose = sensor.read({plant.position_m(), plant.velocity_m_s()});
    Vector3& newest_n = written_n[tick % written_n.size()];
    newest_n = controller.tick(pose, answers.at(tick, pose), time_s);
    const Vector3& felt_n = written_n[(tick + written_n.size() - late) % written_n.size()];
    if (path.exploring(time_s)) errors.add(tissue, plant, pose, answers.newest(), felt_n);
    if (time_s >= HandPath::kHoverS) law_errors.add(tissue, pose, felt_n);
    const HandTarget target = path.at(time_s);
    const Vector3 from_m = plant.position_m();
    plant.step(felt_n, target);
    law_errors.moved(tissue, from_m, plant.position_m(), felt_n);
    result.min_ledger_j = std::min(result.min_ledger_j, controller.last().balance_j);
    if (options.safe && time_s >= HandPath::kHoverS) count_safety(controller, result);
    result.generated_j = std::max(result.generated_j, -plant.port_energy_j());
    result.stored_j = std::max(result.stored_j, plant.port_energy_j());
    drawdown.add(tissue, plant);
    if (time_s >= path.stopped_s()) rest.add(plant.position_m(), time_s - path.stopped_s());
    lost = !((plant.position_m() - target.position_m).norm() < lost_m);
  }
  result.verdict = lost ? Verdict::kUnstable : rest.verdict();
  result.swing_m = lost ? lost_m : rest.swing_m();
  finish(errors, drawdown, result);
  law_errors.finish(result);
  return result;
}

}  // namespace teletact::bench
