#include "service/imaging_plane/estimate_cost.h"

#include <algorithm>
#include <cmath>

namespace teletact::service {

namespace {

constexpr double kLearned = 0.3;  // of a rate, by one measurement

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

// Operations of sparse factors, and of the direct method's blocks.
double modulus_work(const EstimateSize& s, ModulusKind kind) {
  const Nodes n = mesh_nodes(s);
  const double sparse = 60 * std::pow(2 * n.columns * n.rows, 1.5);
  if (kind == ModulusKind::kReferenceStress) return 4 * sparse;
  if (kind == ModulusKind::kSolid) {  // nodes of its block, each in some sixty iterations
    constexpr double kAcross = 64, kOfNode = 1500;
    return kOfNode * 2 * n.columns * n.rows * kAcross;
  }
  return 8 * sparse + 6 * n.columns * std::pow(2 * n.rows, 3);
}

double publishing_work(const EstimateSize& s) {
  const Nodes n = mesh_nodes(s);
  return 3 * n.columns * std::pow(2 * n.rows, 3);
}

}  // namespace

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
  double modulus_s = this->modulus_s(s, s.method);
  if (s.method == ModulusKind::kIterative) {
    // Its start, the direct method, is always finished; then it stops at its limit.
    const double direct_s = this->modulus_s(s, ModulusKind::kDirect);
    modulus_s = std::clamp(modulus_s, std::min(direct_s, s.modulus_time_limit_s),
                           std::max(direct_s, s.modulus_time_limit_s));
  }
  return tracking_.s_per_work * tracking_work(s) + modulus_s + publishing_s(s);
}

double EstimateCost::modulus_s(const EstimateSize& s, ModulusKind kind) const {
  return modulus_[static_cast<std::size_t>(kind)].s_per_work * modulus_work(s, kind);
}

double EstimateCost::publishing_s(const EstimateSize& s) const {
  return s.published ? publishing_.s_per_work * publishing_work(s) : 0;
}

std::array<double, 4> EstimateCost::expected_modulus_s(const EstimateSize& s, Time now) const {
  const std::lock_guard lock(mutex_);
  std::array<double, 4> out;
  for (std::size_t kind = 0; kind < out.size(); ++kind)
    out[kind] = believed(now) * modulus_s(s, static_cast<ModulusKind>(kind));
  return out;
}

double EstimateCost::expected_publishing_s(const EstimateSize& s, Time now) const {
  const std::lock_guard lock(mutex_);
  return believed(now) * publishing_s(s);
}

// What was never tried is as much quicker here as what was.
void EstimateCost::learn_modulus(ModulusKind kind, double seconds, double work) {
  Rate& own = modulus_[static_cast<std::size_t>(kind)];
  const double before = own.s_per_work;
  own.learn(seconds, work);
  for (Rate& other : modulus_)
    if (!other.measured) other.s_per_work *= own.s_per_work / before;
}

void EstimateCost::refused(const EstimateSize& s, double left_s, Time now) {
  const std::lock_guard lock(mutex_);
  if (!(kMinShareRefused * measured_s(s) <= left_s)) return;
  if (!refused_) refused_ = {now};
  refused_->lasted_s += std::min(seconds_between(refused_->last, now), kHalfLifeS);
  refused_->last = now;
}

void EstimateCost::late(Time now) {
  const std::lock_guard lock(mutex_);
  measured_ = now;
  refused_.reset();
}

void EstimateCost::took(const EstimateSize& s, const EstimateSeconds& seconds, Time now) {
  const std::lock_guard lock(mutex_);
  measured_ = now;
  refused_.reset();
  tracking_.learn(seconds.tracking, tracking_work(s));
  learn_modulus(s.method, seconds.modulus, modulus_work(s, s.method));
  // An iteration takes what it is given: what it began with says more of how little would do.
  learn_modulus(ModulusKind::kDirect, seconds.start, modulus_work(s, ModulusKind::kDirect));
  if (s.published) publishing_.learn(seconds.publishing, publishing_work(s));
}

}  // namespace teletact::service
