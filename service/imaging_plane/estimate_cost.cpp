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
double modulus_work(const EstimateSize& s) {
  const Nodes n = mesh_nodes(s);
  const double sparse = 60 * std::pow(2 * n.columns * n.rows, 1.5);
  if (s.method == ModulusKind::kReferenceStress) return 4 * sparse;
  if (s.method == ModulusKind::kSolid) {  // nodes of its block, each in some sixty iterations
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
}

double EstimateCost::believed(Time now) const {
  const auto left = [](double age_s) { return std::exp2(-std::max(age_s, 0.0) / kHalfLifeS); };
  const double idle = std::max(left(seconds_between(measured_, now)), kLeastShare);
  if (!refused_) return idle;
  return std::max(std::min(idle, left(refused_->lasted_s)), kLeastShareRefused);
}

double EstimateCost::expected_s(const EstimateSize& s, Time now) const {
  const std::lock_guard lock(mutex_);
  return believed(now) * measured_s(s);
}

double EstimateCost::measured_s(const EstimateSize& s) const {
  const auto rate = [&](ModulusKind kind) { return modulus_[static_cast<std::size_t>(kind)].s_per_work; };
  double modulus_s = rate(s.method) * modulus_work(s);
  if (s.method == ModulusKind::kIterative) {
    // Its start, the direct method, is always finished; then it stops at its limit.
    const double direct_s = rate(ModulusKind::kDirect) * modulus_work(s);
    modulus_s = std::clamp(modulus_s, std::min(direct_s, s.modulus_time_limit_s),
                           std::max(direct_s, s.modulus_time_limit_s));
  }
  const double publishing_s = s.published ? publishing_.s_per_work * publishing_work(s) : 0;
  return tracking_.s_per_work * tracking_work(s) + modulus_s + publishing_s;
}

void EstimateCost::refused(const EstimateSize& s, double left_s, Time now) {
  const std::lock_guard lock(mutex_);
  if (!(kLeastShareRefused * measured_s(s) <= left_s)) return;
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
  modulus_[static_cast<std::size_t>(s.method)].learn(seconds.modulus, modulus_work(s));
  if (s.published) publishing_.learn(seconds.publishing, publishing_work(s));
}

}  // namespace teletact::service
