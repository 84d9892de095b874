#include "service/imaging_plane/estimate_cost.h"

#include <algorithm>
#include <cmath>

namespace teletact::service {

namespace {

constexpr double kLearned = 0.3;  // of a rate, by one measurement
// s per work of a modulus, by ModulusKind, on an idle core of 2024.
constexpr std::array<double, 4> kUsual{1.5e-10, 6e-11, 1.5e-10, 6e-9};
// Solves of a solid as usual.
constexpr double kLeastSolves = 9;

// Samples that are read: by warps and refinement, and by the search over lags, which grow with the strain.
double tracking_work(const EstimateSize& s) {
  constexpr double kSearched = 4;  // for a reading of the refinement, at max_strain
  const double samples = static_cast<double>(s.samples) * static_cast<double>(s.lines);
  const double lags = s.max_strain * static_cast<double>(s.samples) / 100;
  return samples * (1 + kSearched * s.max_strain / 0.05 * std::min(1.0, lags));
}

double seconds_between(EstimateCost::Time since, EstimateCost::Time until) {
  return std::chrono::duration<double>(until - since).count();
}

struct Nodes {
  double columns, rows;
};
Nodes mesh_nodes(const EstimateSize& s) {
  constexpr double kContext = 20;  // columns beside the window
  return {1e3 * s.window_width_m + kContext, std::clamp(1e3 * s.depth_m, 4.0, 200.0)};
}

// Operations of sparse factors, and of the direct method's blocks; of one step of the iterative method, which
// takes as many factors as reference stress, and of one solve of a solid.
double modulus_work(const EstimateSize& s, ModulusKind kind) {
  const Nodes n = mesh_nodes(s);
  const double sparse = 60 * std::pow(2 * n.columns * n.rows, 1.5);
  switch (kind) {
    case ModulusKind::kReferenceStress:
    case ModulusKind::kIterative:
      return 4 * sparse;
    case ModulusKind::kDirect:
      return 8 * sparse + 6 * n.columns * std::pow(2 * n.rows, 3);
    case ModulusKind::kSolid:  // nodes of its block
      break;
  }
  constexpr double kAcross = 64, kOfNode = 60;
  return kOfNode * 2 * n.columns * n.rows * kAcross;
}

double publishing_work(const EstimateSize& s) {
  const Nodes n = mesh_nodes(s);
  return 3 * n.columns * std::pow(2 * n.rows, 3);
}

ModulusCost modulus_cost(const EstimateSize& s, const std::array<double, 4>& s_per_work) {
  const auto of = [&](ModulusKind kind) {
    return s_per_work[static_cast<std::size_t>(kind)] * modulus_work(s, kind);
  };
  return {of(ModulusKind::kReferenceStress), of(ModulusKind::kDirect), of(ModulusKind::kIterative),
          of(ModulusKind::kSolid)};
}

}  // namespace

ModulusCost usual_modulus(const EstimateSize& s) {
  return modulus_cost(s, kUsual);
}

EstimateCost::EstimateCost() {
  constexpr double kSlow = 3;
  for (std::size_t kind = 0; kind < kUsual.size(); ++kind) modulus_[kind].s_per_work = kSlow * kUsual[kind];
}

void EstimateCost::Rate::learn(double seconds, double work) {
  if (!(seconds > 0 && work > 0)) return;
  s_per_work += kLearned * (seconds / work - s_per_work);
  measured = true;
}

double EstimateCost::believed(Time now) const {
  const auto left = [](double age_s) { return std::exp2(-std::max(age_s, 0.0) / kHalfLifeS); };
  const double idle = std::max(left(seconds_between(measured_, now)), kMinShare);
  if (!refused_) return idle;
  return std::max(std::min(idle, left(refused_->lasted_s)), kMinShareRefused);
}

double EstimateCost::expected_s(const EstimateSize& s, Time now) const {
  const std::lock_guard lock(mutex_);
  return believed(now) * measured_s(s);
}

double EstimateCost::measured_s(const EstimateSize& s) const {
  return modulus_s(s) + beside_modulus_s(s);
}

double EstimateCost::beside_modulus_s(const EstimateSize& s) const {
  return tracking_.s_per_work * tracking_work(s) + publishing_s(s);
}

double EstimateCost::min_s(const EstimateSize& s, bool planned, Time now) const {
  const std::lock_guard lock(mutex_);
  const ModulusCost cost = modulus_cost(s, 1);
  const double modulus_s = planned                               ? cost.reference_s
                           : s.method == ModulusKind::kIterative ? cost.direct_s
                           : s.method == ModulusKind::kSolid     ? kLeastSolves * cost.solve_s
                                                                 : this->modulus_s(s);
  return believed(now) * (modulus_s + beside_modulus_s(s));
}

double EstimateCost::modulus_s(const EstimateSize& s) const {
  const ModulusCost cost = modulus_cost(s, 1);
  const ModulusBudget limit = usual_modulus(s).within(s.modulus_time_limit_s, "");
  switch (s.method) {
    case ModulusKind::kReferenceStress:
      return cost.reference_s;
    case ModulusKind::kDirect:
      return cost.direct_s;
    case ModulusKind::kIterative:
      return cost.direct_s + (1 + std::min<double>(steps_, limit.steps)) * cost.step_s;
    case ModulusKind::kSolid:
      break;
  }
  return std::min(solves_, std::max<double>(kLeastSolves, limit.solves)) * cost.solve_s;
}

ModulusCost EstimateCost::modulus_cost(const EstimateSize& s, double share) const {
  std::array<double, 4> rates;
  std::ranges::transform(modulus_, rates.begin(), [&](const Rate& rate) { return share * rate.s_per_work; });
  return service::modulus_cost(s, rates);
}

double EstimateCost::publishing_s(const EstimateSize& s) const {
  return s.published ? publishing_.s_per_work * publishing_work(s) : 0;
}

ModulusBudget EstimateCost::budget(const EstimateSize& s, double left_s, const std::string& why,
                                   Time now) const {
  const std::lock_guard lock(mutex_);
  ModulusBudget out = modulus_cost(s, 1).within(left_s, why);
  if (!out.start && modulus_cost(s, believed(now)).within(left_s, why).start) {
    out.start = true, out.why_steps = why;
  }
  return out;
}

double EstimateCost::expected_publishing_s(const EstimateSize& s, Time now) const {
  const std::lock_guard lock(mutex_);
  return believed(now) * publishing_s(s);
}

void EstimateCost::refused(const EstimateSize& s, double left_s, Time now) {
  const std::lock_guard lock(mutex_);
  if (!(kMinShareRefused * measured_s(s) <= left_s)) return;
  if (!refused_) refused_ = {now};
  refused_->lasted_s += std::min(seconds_between(refused_->last, now), kHalfLifeS);
  refused_->last = now;
}

void EstimateCost::late(const EstimateSize& s, double worked_s, Time now) {
  const std::lock_guard lock(mutex_);
  measured_ = now;
  refused_.reset();
  if (const double expected_s = measured_s(s); worked_s > expected_s)
    rate(s.method).s_per_work *= worked_s / expected_s;
}

void EstimateCost::took(const EstimateSize& s, const EstimateSeconds& seconds, Time now) {
  const std::lock_guard lock(mutex_);
  measured_ = now;
  refused_.reset();
  tracking_.learn(seconds.tracking, tracking_work(s));
  const bool iterated = s.method == ModulusKind::kIterative, solid = s.method == ModulusKind::kSolid;
  // After its start an iteration takes its steps, and as long as one more to say how well its answer is
  // known.
  const double times = iterated ? (seconds.steps > 0 ? 1 + seconds.steps : 0) : solid ? seconds.steps : 1;
  rate(s.method).learn(seconds.modulus - seconds.start, times * modulus_work(s, s.method));
  rate(ModulusKind::kDirect).learn(seconds.start, modulus_work(s, ModulusKind::kDirect));
  if (seconds.modulus > 0) {
    if (iterated) steps_ += kLearned * (seconds.steps - steps_);
    if (solid) solves_ += kLearned * (seconds.steps - solves_);
    // What was never tried is as much quicker here as what was.
    const auto by = static_cast<std::size_t>(s.method);
    for (std::size_t kind = 0; kind < kUsual.size(); ++kind)
      if (!modulus_[kind].measured && modulus_[by].measured)
        modulus_[kind].s_per_work = kUsual[kind] * modulus_[by].s_per_work / kUsual[by];
  }
  if (s.published) publishing_.learn(seconds.publishing, publishing_work(s));
}

}  // namespace teletact::service
