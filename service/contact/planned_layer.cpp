#include "service/contact/planned_layer.h"

#include <cmath>
#include <stdexcept>
#include <utility>

#include "service/base/choices.h"

namespace teletact::service {

PlannedLayer::PlannedLayer(std::shared_ptr<SolidLayer> solid, const TouchWay& way, double deviation)
    : solid_(std::move(solid)),
      nodes_(solid_),
      path_(way.path),
      pressure_(way.pressure),
      tolerance_(way.tolerance.value_or(usual_tolerance(deviation))),
      asked_for_(way.tolerance.has_value()),
      planner_(way.planner ? way.planner : std::make_shared<Planner>()) {}

// For a law. Poses are touched in any order: no choice depends on the one before. What a light one is off by
// is stated of its whole column, so newtons do not excuse it.
PlannedLayer::PlannedLayer(const PlannedLayer& same, std::shared_ptr<TouchedLayer> nodes)
    : solid_(same.solid_),
      nodes_(std::move(nodes)),
      path_(same.path_),
      pressure_(false),
      tolerance_{same.tolerance_.relative, 0},
      asked_for_(same.asked_for_),
      planner_(std::make_shared<Planner>(Planner::Clock::duration::zero())) {}

std::shared_ptr<TouchedLayer> PlannedLayer::apart() {
  solid_->learn_shares();
  return std::shared_ptr<PlannedLayer>(new PlannedLayer(*this, solid_->apart()));
}

auto PlannedLayer::shares(const Fingertip& tip, const Vector3& at) -> Shares {
  if (!shares_.second || shares_.first != tip) shares_ = {tip, solid_->shares(tip)};
  return shares_.second && at[1] <= shares_.second->max_m() ? shares_.second : nullptr;
}

// What was asked for is judged with finite strain.
double PlannedLayer::over(const SharesTouch& shares, const Vector3& at) const {
  return shares.over(at, tolerance_, asked_for_ ? FiniteStrain::kCounts : FiniteStrain::kLeftOut);
}

auto PlannedLayer::choose(const Fingertip& tip, const TouchPose& pose) -> Shares {
  solid_->require_covered(tip, pose);
  const Vector3 at = solid_->in_block(pose);
  if (!(at[1] > 0)) return nullptr;
  const std::lock_guard lock(mutex_);
  Shares shares = pressure_ ? nullptr : this->shares(tip, at);
  if (shares && path_ == SolvePath::kAuto &&
      !planner_->takes_shares(over(*shares, at), Planner::Clock::now()))
    shares = nullptr;
  by_nodes_ = !shares;
  return shares;
}

bool PlannedLayer::prepare(const Fingertip& tip, const TouchPose& pose, double around_m,
                           Clock::time_point until) try {
  if (around_m > 0) return nodes_->prepare(tip, pose, around_m, until);  // no touch: nothing is chosen
  return choose(tip, pose) || meanwhile(tip, pose, choices::kTrustedMeanwhile) ||
         nodes_->prepare(tip, pose, 0, until) || meanwhile(tip, pose, HUGE_VAL);
} catch (const std::domain_error&) {
  try {
    nodes_->touch(tip, pose);
  } catch (const std::domain_error&) {  // there is no contact, as touch() says
    return true;
  }
  throw;  // there is: its correction broke down
}

// Nothing is chosen for a finger that is answered elsewhere.
bool PlannedLayer::welcomes(const Fingertip& tip, const TouchPose& pose) {
  solid_->require_covered(tip, pose);
  if (!(pose.position_m[1] > 0)) return true;
  return shares_will_do(tip, solid_->in_block(pose)) || meanwhile(tip, pose, choices::kTrustedMeanwhile) ||
         nodes_->welcomes(tip, pose);
}

bool PlannedLayer::shares_will_do(const Fingertip& tip, const Vector3& at) {
  const std::lock_guard lock(mutex_);
  const Shares shares = pressure_ ? nullptr : this->shares(tip, at);
  return shares && (path_ != SolvePath::kAuto || over(*shares, at) <= 1);
}

ContactAnswer PlannedLayer::touch(const Fingertip& tip, const TouchPose& pose) {
  if (const Shares shares = choose(tip, pose)) return shares->answer(solid_->in_block(pose));
  try {
    ContactAnswer answer = nodes_->touch(tip, pose);
    const SolveReport& solve = answer.solve;
    if (!solve.converged && solve.relative_error - solve.of_model > choices::kTrustedMeanwhile)
      if (auto better = meanwhile(tip, pose, solve.relative_error)) {
        better->solve.improving = solve.improving;
        if (!solve.improving) better->solve.reason = kFailedReason;
        return std::move(*better);
      }
    return answer;
  } catch (const std::domain_error&) {
    const std::lock_guard lock(mutex_);
    if (auto answer = in_the_nodes_place(tip, solid_->in_block(pose), kNoContactReason))
      return std::move(*answer);
    throw;
  }
}

std::optional<ContactAnswer> PlannedLayer::meanwhile(const Fingertip& tip, const TouchPose& pose,
                                                     double error) {
  const Vector3 at = solid_->in_block(pose);
  const std::lock_guard lock(mutex_);
  if (nodes_ != solid_ || pressure_ || asked_for_ || !(at[1] > 0)) return {};
  auto answer = in_the_nodes_place(tip, at, kLateReason);
  if (answer && !(answer->solve.relative_error < error)) return {};
  return answer;
}

std::optional<ContactAnswer> PlannedLayer::in_the_nodes_place(const Fingertip& tip, const Vector3& at,
                                                              const char* reason) {
  const Shares shares = this->shares(tip, at);
  if (!shares) return {};
  ContactAnswer answer = shares->answer(at);
  answer.solve.converged = false;
  answer.solve.reason = reason;
  answer.solve.relative_error = shares->half_width(at);
  return answer;
}

std::optional<std::vector<NodalPressure>> PlannedLayer::layered_pressure(const Fingertip& tip,
                                                                         const TouchPose& pose,
                                                                         double force_n) const {
  return solid_->layered_pressure(tip, pose, force_n);
}

std::string PlannedLayer::remark(const Fingertip& tip, const TouchPose& pose) const {
  return by_nodes_ ? solid_->remark(tip, pose) : "";
}

}  // namespace teletact::service
