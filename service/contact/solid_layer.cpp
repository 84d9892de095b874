#include "service/contact/solid_layer.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "service/base/choices.h"
#include "service/contact/fingertip.h"
#include "service/device/device.h"

namespace teletact::service {
namespace {

constexpr double kStillMS = 0.001;  // a finger slower than this rests

double error_of(const SolveReport& solve) {
  return settled(solve) ? 0 : solve.relative_error - solve.of_model;
}

// Others would fail as well, and another device may not. Once: the next touch tries again.
void rethrow_of_device(Corrector& corrector, const std::exception_ptr& failure) try {
  std::rethrow_exception(failure);
} catch (const DeviceMemoryError&) {
} catch (const DeviceError&) {
  corrector.forget_failure();
  throw;
} catch (const std::exception&) {
}

}  // namespace

// Poses of a law are touched in any order: no choice depends on the one before. What a light one is off by is
// stated of its whole column, so newtons do not excuse it.
SolidLayer::SolidLayer(std::shared_ptr<SolidNodes> nodes, const TouchWay& way, double deviation)
    : TouchedLayer(nodes->device),
      nodes_(std::move(nodes)),
      law_(way.law),
      planned_(way.shares && way.path != SolvePath::kGradients && nodes_->contact.row() == 0),
      by_name_(way.path == SolvePath::kShares),
      pressure_(way.pressure && !law_),
      asked_for_(way.tolerance.has_value()),
      tolerance_([&] {
        const Tolerance usual = way.tolerance.value_or(usual_tolerance(deviation));
        return law_ ? Tolerance{usual.relative, 0} : usual;
      }()),
      planner_(law_          ? std::make_shared<Planner>(Planner::Clock::duration::zero())
               : way.planner ? way.planner
                             : std::make_shared<Planner>()) {}

auto SolidLayer::shares(const Fingertip& tip, const Vector3& at) -> Shares {
  if (!planned_) return nullptr;
  if (!shares_ || !shares_->second || shares_->first != tip) shares_ = {tip, nodes_->contact.shares(tip)};
  return shares_->second && at[1] <= shares_->second->max_m() ? shares_->second : nullptr;
}

// What was asked for is judged with finite strain.
double SolidLayer::over(const SharesTouch& shares, const Vector3& at) const {
  return shares.over(at, tolerance_, asked_for_ ? FiniteStrain::kCounts : FiniteStrain::kLeftOut);
}

auto SolidLayer::choose(const Fingertip& tip, const Vector3& at) -> Shares {
  if (!(at[1] > 0)) return nullptr;
  const std::lock_guard lock(mutex_);
  Shares shares = pressure_ ? nullptr : this->shares(tip, at);
  if (shares && !by_name_ && !planner_->takes_shares(over(*shares, at), Planner::Clock::now()))
    shares = nullptr;
  chosen_ = {tip, at, shares != nullptr};
  return shares;
}

bool SolidLayer::shares_will_do(const Fingertip& tip, const Vector3& at) {
  const std::lock_guard lock(mutex_);
  if (chosen_ && chosen_->tip == tip && chosen_->at == at) return chosen_->shares;
  const Shares shares = pressure_ ? nullptr : this->shares(tip, at);
  return shares && (by_name_ || over(*shares, at) <= 1);
}

ContactAnswer SolidLayer::answer(const Fingertip& tip, const TouchPose& pose) {
  nodes_->require_covered(tip, pose);
  if (law_) make_own();
  const Vector3 at = nodes_->in_block(pose);
  if (const Shares shares = choose(tip, at)) return shares->answer(at);
  ContactAnswer answer;
  try {
    answer = by_nodes(tip, pose);
    const SolveReport nodes = answer.solve;
    if (!nodes.converged && nodes.relative_error - nodes.of_model > choices::kTrustedMeanwhile)
      if (auto better = meanwhile(tip, at, nodes.relative_error)) {
        answer = std::move(*better);
        answer.solve.improving = nodes.improving;
        if (!nodes.improving) answer.solve.reason = kFailedReason;
      }
  } catch (const std::domain_error&) {
    auto other = in_the_nodes_place(tip, at, kNoContactReason);
    if (!other) throw;
    answer = std::move(*other);
  }
  answer.remark = coarse_mesh(tip, at[1], std::max(nodes_->spacing_m[0], nodes_->spacing_m[1]));
  return answer;
}

std::optional<ContactAnswer> SolidLayer::meanwhile(const Fingertip& tip, const Vector3& at, double error) {
  if (law_ || pressure_ || asked_for_ || !(at[1] > 0)) return {};
  auto answer = in_the_nodes_place(tip, at, kLateReason);
  if (answer && !(answer->solve.relative_error < error)) return {};
  return answer;
}

std::optional<ContactAnswer> SolidLayer::in_the_nodes_place(const Fingertip& tip, const Vector3& at,
                                                            const char* reason) {
  const Shares shares = [&] {
    const std::lock_guard lock(mutex_);
    return this->shares(tip, at);
  }();
  if (!shares) return {};
  ContactAnswer answer = shares->answer(at);
  answer.solve.converged = false;
  answer.solve.reason = reason;
  answer.solve.relative_error = shares->half_width(at);
  return answer;
}

ContactAnswer SolidLayer::by_nodes(const Fingertip& tip, const TouchPose& pose) {
  ContactAnswer answer;
  if (law_) {
    if (!std::exchange(felt_, true)) {
      const std::lock_guard lock(*of_law_->mutex);
      of_law_->contact.feel();
    }
    answer = of_law_->contact.felt_answer(tip, nodes_->in_block(pose));
  } else {
    const std::exception_ptr failure = nodes_->corrector.failure();
    if (failure) rethrow_of_device(nodes_->corrector, failure);
    answer = answered(tip, pose);
    answer.solve.iterations = nodes_->iterations.exchange(0);
    if (!settled(answer.solve)) {
      answer.solve.improving = !failure;
      answer.solve.reason = failure ? "its correction failed" : "not corrected yet";
    }
  }
  answer.path = SolvePath::kGradients;
  nodes_->move_to_scene(answer.pressure);
  return answer;
}

ContactAnswer SolidLayer::answered(const Fingertip& tip, const TouchPose& pose) {
  const std::uint64_t done = nodes_->corrector.done();
  {
    const std::lock_guard lock(mutex_);
    if (last_ && last_->done == done && last_->tip == tip && last_->position_m == pose.position_m)
      return last_->answer;  // answered, then asked what it wants
  }
  Last last{tip, pose.position_m, done, nodes_->contact.felt_answer(tip, nodes_->in_block(pose))};
  const std::lock_guard lock(mutex_);
  last_ = last;
  return std::move(last.answer);
}

std::optional<TouchJob> SolidLayer::wanted(const Fingertip& tip, const TouchPose& pose, double around_m) try {
  nodes_->require_covered(tip, pose);
  if (law_) make_own();
  const Vector3 at = nodes_->in_block(pose);
  if (!(at[1] > 0) || around_m > 0 || shares_will_do(tip, at)) return {};
  if (law_) return wanted_of_law(tip, at);
  const auto [vx, vy, vz] = pose.velocity_m_s;
  TouchJob job{error_of(answered(tip, pose).solve)};
  if (!(job.error > 0) && !(std::hypot(vx, vy, vz) > kStillMS)) return {};
  job.work = [this, tip, pose](Clock::time_point until) { return correct(tip, pose, until); };
  if (!(job.error > 0)) return job;
  job.wait = job.error <= choices::kTrustedMeanwhile ? JobWait::kAwaited : JobWait::kFirst;
  if (const auto shares = meanwhile(tip, at, HUGE_VAL)) {
    const double error = shares->solve.relative_error;
    job.wait = error < choices::kTrustedMeanwhile ? JobWait::kBeside : JobWait::kAwaited;
    job.error = std::min(job.error, error);
  }
  return job;
} catch (const std::domain_error&) {  // there is no contact, which nothing changes
  return {};
}

// Asks for corrections until the time is up, or no more helps. One that is begun ends.
bool SolidLayer::correct(const Fingertip& tip, const TouchPose& pose, Clock::time_point until) {
  Corrector& corrector = nodes_->corrector;
  const auto done_with = [&] {
    try {
      return settled(answered(tip, pose).solve);
    } catch (const std::domain_error&) {  // the nodes have no contact, which the answer says
      return true;
    }
  };
  for (std::size_t corrections = 0; corrections < choices::kMaxCorrections; ++corrections) {
    const std::uint64_t done = corrector.done();
    const bool waits = Clock::now() < until;
    if (!waits && corrections > 0) return false;
    corrector.ask(tip, waits ? TouchPose{pose.position_m} : pose);
    if (!waits) return false;
    corrector.wait_for_more_than(done, until + choices::kLongestSolve);
    if (done_with()) return true;
    if (const auto failure = corrector.failure()) std::rethrow_exception(failure);  // it was waited for
  }
  return true;
}

std::optional<TouchJob> SolidLayer::wanted_of_law(const Fingertip& tip, const Vector3& at) {
  SolidNodes& own = *of_law_;
  const auto known = [&own, tip, at] { return own.contact.answer(tip, at, choices::kLawShare).solve; };
  const double error = error_of(known());
  if (!(error > 0)) return {};
  const auto work = [&own, tip, at, known](Clock::time_point) {
    for (std::size_t corrections = 0; corrections < choices::kMaxCorrections; ++corrections) {
      if (settled(known())) break;
      const std::lock_guard lock(*own.mutex);  // for one: others wait with a finger
      own.contact.correct(tip, at, choices::kLawShare);
    }
    return true;
  };
  return TouchJob{error, JobWait::kFirst, work};
}

void SolidLayer::make_own() {
  if (of_law_) return;
  if (planned_) nodes_->learn_shares();
  of_law_ = std::make_shared<SolidNodes>(*nodes_, nodes_->contact.row(), nodes_->account);
}

std::optional<std::vector<NodalPressure>> SolidLayer::layered_pressure(const Fingertip& tip,
                                                                       const TouchPose& pose,
                                                                       double force_n) const {
  if (force_n <= 0) return std::vector<NodalPressure>{};
  auto pressure = nodes_->contact.layered_pressure(tip, nodes_->in_block(pose), force_n);
  nodes_->move_to_scene(pressure);
  return pressure;
}

std::optional<DeformedLayer> SolidLayer::deformed(const Fingertip& tip, const TouchPose& pose,
                                                  double around_m, std::size_t max_nodes) const {
  nodes_->require_covered(tip, pose);
  const SolidGrid& grid = nodes_->contact.tissue().grid;
  const auto most = static_cast<std::size_t>(std::sqrt(static_cast<double>(max_nodes)));
  const auto shown = [&](std::size_t count, double origin_m, double spacing_m, double at_m, double begin_m,
                         double end_m, std::vector<double>& places_m) {
    std::vector<std::size_t> indices;
    for (std::size_t i = 0; i < count; ++i) {
      const double place_m = origin_m + spacing_m * static_cast<double>(i);
      if (place_m >= begin_m && place_m <= end_m && std::abs(place_m - at_m) <= around_m)
        indices.push_back(i);
    }
    indices = every(indices, most);
    for (const std::size_t i : indices) places_m.push_back(origin_m + spacing_m * static_cast<double>(i));
    return indices;
  };
  DeformedLayer out;
  const auto along_x = shown(grid.nx, nodes_->origin_x_m, grid.spacing_x_m, pose.position_m[0],
                             nodes_->region.begin_x_m, nodes_->region.end_x_m, out.x_m);
  const auto along_z = shown(grid.nz, nodes_->origin_z_m, grid.spacing_z_m, pose.position_m[2],
                             nodes_->region.z->begin_m, nodes_->region.z->end_m, out.z_m);
  std::vector<std::size_t> nodes;
  for (const std::size_t k : along_z)
    for (const std::size_t i : along_x) nodes.push_back(i + grid.nx * k);
  const Eigen::VectorXd moved = nodes_->contact.moved_m(tip, nodes_->in_block(pose), nodes);
  out.displacement_m.assign(moved.begin(), moved.end());
  return out;
}

}  // namespace teletact::service
