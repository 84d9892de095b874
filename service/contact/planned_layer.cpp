#include "service/contact/planned_layer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "service/plan/choices.h"

namespace teletact::service {
namespace {

constexpr double kUsualM = 0.002;  // what is said is of touches so deep

const char* words_of(SolvePath path) {
  switch (path) {
    case SolvePath::kLayer:
      return "a homogeneous layer";
    case SolvePath::kLayers:
      return "layers";
    default:
      return "log-weighted shares";
  }
}

}  // namespace

std::array<double, kClosedForms.size()> over_allowed(const ClosedTouch& closed, const Vector3& pose,
                                                     const Tolerance& tolerance, FiniteStrain finite) {
  return {closed.most_over(SolvePath::kLayer, tolerance, finite),
          closed.most_over(SolvePath::kLayers, tolerance, finite),
          closed.over(SolvePath::kShares, pose, tolerance, finite)};
}

std::string plan_of(const Fingertip& tip, const ClosedTouch& closed, const Tolerance& tolerance) {
  const auto off = [&](SolvePath path) {
    return fmt::format("{:.2g} % by {}", 100 * closed.most_half_width(path, kUsualM), words_of(path));
  };
  const auto chosen = std::ranges::find_if(kClosedForms, [&](SolvePath path) {
    return closed.most_over(path, tolerance, FiniteStrain::kLeftOut) <= 1;
  });
  std::string all;
  for (const SolvePath path : kClosedForms) all += (all.empty() ? "" : ", ") + off(path);
  return fmt::format(
      "a round tip of {:.3g} mm is answered by {}: at {:.0f} mm it may be off by up to {}, where {:.2g} % or "
      "{:.2g} mN are allowed",
      1e3 * tip.radius_m,
      chosen == kClosedForms.end() ? "log-weighted shares where they do, else by the nodes of the solid"
                                   : words_of(*chosen),
      1e3 * kUsualM, all, 100 * tolerance.relative, 1e3 * tolerance.force_n);
}

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

std::shared_ptr<const ClosedTouch> PlannedLayer::closed(const Fingertip& tip) {
  if (!closed_.second || closed_.first != tip) closed_ = {tip, solid_->closed(tip)};
  return closed_.second;
}

// What was asked for is judged with finite strain.
std::array<double, kClosedForms.size()> PlannedLayer::over(const ClosedTouch& closed,
                                                           const Vector3& at) const {
  return over_allowed(closed, at, tolerance_, asked_for_ ? FiniteStrain::kCounts : FiniteStrain::kLeftOut);
}

auto PlannedLayer::choose(const Fingertip& tip, const TouchPose& pose) -> Choice {
  solid_->require_covered(tip, pose);
  const Vector3 at = solid_->in_block(pose);
  const std::lock_guard lock(mutex_);
  Choice choice;
  const auto closed = at[1] > 0 && !pressure_ ? this->closed(tip) : nullptr;
  if (closed && at[1] <= closed->most_m()) {
    std::array<double, kClosedForms.size() + 1> over{};  // of the nodes: 0
    std::ranges::copy(this->over(*closed, at), over.begin());
    const auto chosen =
        path_ == SolvePath::kAuto
            ? planner_->choose(over, Planner::Clock::now())
            : static_cast<std::size_t>(std::ranges::find(kClosedForms, path_) - kClosedForms.begin());
    if (chosen < kClosedForms.size()) choice = {closed, kClosedForms[chosen]};
  }
  if (at[1] > 0) by_nodes_ = !choice.closed;
  return choice;
}

bool PlannedLayer::prepare(const Fingertip& tip, const TouchPose& pose, double around_m,
                           Clock::time_point until) try {
  if (around_m > 0) return nodes_->prepare(tip, pose, around_m, until);  // no touch: nothing is chosen
  return choose(tip, pose).closed || meanwhile(tip, pose, choices::kTrustedMeanwhile) ||
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
  return closed_will_do(tip, solid_->in_block(pose)) || meanwhile(tip, pose, choices::kTrustedMeanwhile) ||
         nodes_->welcomes(tip, pose);
}

bool PlannedLayer::closed_will_do(const Fingertip& tip, const Vector3& at) {
  const std::lock_guard lock(mutex_);
  const auto closed = pressure_ ? nullptr : this->closed(tip);
  if (!closed || at[1] > closed->most_m()) return false;
  return path_ != SolvePath::kAuto || std::ranges::any_of(over(*closed, at), [](double o) { return o <= 1; });
}

ContactAnswer PlannedLayer::touch(const Fingertip& tip, const TouchPose& pose) {
  if (const Choice choice = choose(tip, pose); choice.closed)
    return choice.closed->answer(choice.path, solid_->in_block(pose));
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
  const auto closed = this->closed(tip);
  if (!closed || at[1] > closed->most_m()) return {};
  ContactAnswer answer = closed->answer(SolvePath::kShares, at);
  answer.solve.converged = false;
  answer.solve.reason = reason;
  answer.solve.relative_error = closed->half_width(SolvePath::kShares, at);
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
