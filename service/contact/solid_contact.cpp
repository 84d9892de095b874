#include "service/contact/solid_contact.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

#include "service/contact/fingertip.h"
#include "service/contact/solid_answer.h"
#include "service/contact/solid_patch.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kHalfSpaceEdge = 0.5;  // of a contact on a half space (first_guess)
// A node that touches although it overlaps by less than this share of the margin: there may be others beyond.
constexpr double kInnerMargin = 0.8;
// Of the force error that is asked, what a correction is solved to, in energy.
constexpr double kCorrectionShare = 0.3;
// How much less well the block is solved for the tangent, and how well at least.
constexpr double kTangentShare = 30, kMinForTangent = 0.05;
// Forces this smooth are felt through the tissue below, finer ones by what lies at the surface.
constexpr double kFeltM = 0.001;
// What rounding leaves of a force (solid_contact_test).
template <class T>
constexpr double kRounding = sizeof(T) == sizeof(double) ? 1e-9 : 4e-5;

// Error of the force over how far the factor's layers have drifted: of the skin, and of what lies beyond the
// block. Measured: 0.055 (slices_test).
constexpr double kOfDrift = 0.1;

void require_touchable(const SolidGrid& grid, std::size_t row, const Fingertip& tip, const Vector3& pose) {
  validate(tip);
  for (const double component : pose)
    if (!std::isfinite(component)) throw std::invalid_argument("pose: not finite");
  const double below_m = grid.y_m.back() - grid.y_m[row];
  if (pose[1] >= below_m)
    throw std::invalid_argument(
        fmt::format("pose: {} m deep in tissue of {} m; stay above its bottom", pose[1], below_m));
}

// None where nothing touches.
std::optional<SolidTouch> find_contact(const SolidGrid& grid, const RecycledCompliance& compliance,
                                       const Fingertip& tip, const Vector3& pose, std::size_t& iterations) {
  if (tip.shape == FingertipShape::kNode) return touch_node(grid, compliance, tip, pose);
  // Of the nodes that may touch; grows where the tissue bulges up to the outermost.
  for (double margin_m = choices::kCandidateMargin * pose[1];; margin_m *= 2) {
    const SolidPatch patch = patch_under(grid, compliance, tip, pose, margin_m);
    if (patch.nodes.empty()) return {};  // between nodes, above all of them
    const PatchSolution s =
        solve_patch(patch.programme, first_guess(patch.programme, pose[1], kHalfSpaceEdge));
    iterations += s.iterations;
    const double least = min_overlap_m(patch, s);
    if (least == HUGE_VAL) return {};
    if (least >= -kInnerMargin * margin_m) return SolidTouch{energy_of(patch, s), linearise(patch, s)};
  }
}

}  // namespace

LayersDrift drift_between(const LayeredTissue& factor, const LayeredTissue& own) {
  const std::size_t layers = own.youngs_modulus_pa.size();
  const auto softer = [&](std::size_t j) {
    return std::log(factor.youngs_modulus_pa[j] / own.youngs_modulus_pa[j]);
  };
  double mean = 0, most = 0;
  for (std::size_t j = 0; j < layers; ++j) mean += softer(j) / static_cast<double>(layers);
  for (std::size_t j = 0; j < layers; ++j) most = std::max(most, std::abs(softer(j) - mean));
  return {std::exp(mean), most};
}

template <class T>
SolidContact<T>::Factor::Factor(const Queue& queue, const SolidTissue& tissue)
    : queue(queue), solver(queue, tissue), surface(solver.row()) {}

template <class T>
auto SolidContact<T>::Factor::row(const SolidGrid& grid, const LayeredTissue& tissue, double poisson_ratio,
                                  std::size_t index) -> std::shared_ptr<Row> {
  const std::lock_guard lock(mutex);
  if (auto made = rows[index].lock()) return made;
  const auto compliance = [&](double min_period_m, double smooth_m) {
    return wide_surface(grid, tissue, poisson_ratio, min_period_m, smooth_m, index);
  };
  const double wide_m = choices::kMinPeriod * grid.y_m.back();
  auto solved = index == 0 ? surface : std::make_shared<const SolidRow>(SolidRow{index, compliance(0, 0)});
  auto made = std::make_shared<Row>(std::move(solved), compliance(wide_m, 0), compliance(wide_m, kFeltM));
  rows[index] = made;
  return made;
}

template <class T>
SolidContact<T>::SolidContact(const SolidTissue& tissue, std::shared_ptr<Factor> factor,
                              std::shared_ptr<const SolidModulus<T>> modulus, std::size_t row)
    : tissue_(tissue),
      factor_(std::move(factor)),
      modulus_(modulus ? std::move(modulus) : factor_->solver.modulus()),
      row_(factor_->row(tissue.grid, modulus_->layers, tissue.poisson_ratio, row)),
      drift_(drift_between(modulus_->layers, layered(tissue))),
      layered_(std::make_shared<const RecycledCompliance>(tissue.grid, modulus_->layers, 0, 3, row_->wide,
                                                          row_->smooth, row_->solved->layered, drift_.scale)),
      frictionless_(std::make_shared<const RecycledCompliance>(tissue.grid, modulus_->layers, 1, 1,
                                                               row_->wide, row_->smooth,
                                                               row_->solved->layered, drift_.scale)),
      stuck_(layered_) {}

template <class T>
SolidContact<T>::SolidContact(const Queue& queue, const SolidTissue& tissue)
    : SolidContact(tissue, std::make_shared<Factor>(queue, tissue), nullptr, 0) {
  feel();
}

template <class T>
SolidContact<T>::SolidContact(const Queue& queue, const SolidContact& before, const SolidTissue& tissue)
    : SolidContact(tissue, before.factor_,
                   std::make_shared<const SolidModulus<T>>(
                       queue, tissue, beside(tissue, before.modulus_->layers.youngs_modulus_pa)),
                   before.row_->solved->index) {}

template <class T>
SolidContact<T>::SolidContact(const SolidContact& same, std::size_t row)
    : SolidContact(same.tissue_, same.factor_, same.modulus_, row) {}

template <class T>
auto SolidContact<T>::known(const Fingertip& tip) const -> Known {
  const std::lock_guard lock(mutex_);
  return tip.friction == Friction::kStuck ? stuck_ : frictionless_;
}

template <class T>
void SolidContact<T>::feel() {
  if (felt_) return;
  if (!row_->shares) {
    SolidSolver<T>& solver = factor_->solver;
    const auto load = EnergyShares::usual_load(tissue_.grid);
    solver.use(modulus_);
    solver.at(row_->solved);
    solver.load(load.unknowns, load.force_n, {.relative_error = HUGE_VAL, .max_iterations = 0});
    const std::vector<T> u = solver.displacement();
    row_->shares.emplace(factor_->queue, tissue_.grid, modulus_->layers, tissue_.poisson_ratio,
                         std::vector<double>(u.begin(), u.end()));
  }
  const auto felt = std::make_shared<const FeltModulus>(row_->shares->felt(tissue_, drift_.scale));
  felt_ = true;
  const std::lock_guard lock(mutex_);
  for (Known* known : {&frictionless_, &stuck_}) {
    auto next = std::make_shared<RecycledCompliance>(**known);
    next->feel(felt);
    *known = std::move(next);
  }
}

template <class T>
ContactAnswer SolidContact<T>::answer(const Fingertip& tip, const Vector3& pose, double force_error) const {
  return answer_by(*known(tip), tip, pose, force_error);
}

template <class T>
void SolidContact<T>::learn_shares(const Queue& queue, std::mutex& solving) {
  if (row() > 0) return;
  const std::lock_guard learning(row_->learning);
  {
    const std::lock_guard lock(mutex_);
    if (felt_force_) return;
  }
  SolidSolver<T>& solver = factor_->solver;
  const auto layered_field = [&](const std::vector<std::size_t>& unknowns, const VectorXd& force_n) {
    const std::lock_guard lock(solving);  // others' corrections in between
    solver.use(modulus_);
    solver.at(row_->solved);
    solver.load(unknowns, force_n, {.relative_error = HUGE_VAL, .max_iterations = 0});
    const std::vector<T> u = solver.displacement();
    return std::vector<float>(u.begin(), u.end());
  };
  if (!row_->force_shares)
    row_->force_shares.emplace(queue, tissue_.grid, modulus_->layers, tissue_.poisson_ratio, layered_field);
  auto felt = std::make_shared<const FeltForce>(row_->force_shares->felt(tissue_, drift_.scale));
  const std::lock_guard lock(mutex_);
  felt_force_ = std::move(felt);
}

template <class T>
bool SolidContact<T>::has_learned() const {
  const std::lock_guard lock(mutex_);
  return felt_force_ != nullptr;
}

template <class T>
std::shared_ptr<const SharesTouch> SolidContact<T>::shares(const Fingertip& tip) const {
  const auto felt = [&] {
    const std::lock_guard lock(mutex_);
    return felt_force_;
  }();
  const auto exact = felt ? exact_touch(tip) : nullptr;
  if (!exact) return nullptr;
  auto shares = std::make_shared<const SharesTouch>(tissue_, tip, exact, felt, drift_.scale);
  return shares->max_m() > 0 ? shares : nullptr;
}

template <class T>
std::shared_ptr<const LayeredTouch> SolidContact<T>::exact_touch(const Fingertip& tip) const {
  constexpr std::size_t kMaxTips = 32;
  if (row() > 0 || !round_and_frictionless(tip)) return nullptr;
  auto& exact = factor_->exact;
  const auto found = [&]() -> std::shared_ptr<const LayeredTouch> {
    const auto at = std::ranges::find(exact, tip, [](const auto& e) { return e.first; });
    if (at == exact.end()) return nullptr;
    std::rotate(at, at + 1, exact.end());  // the one used longest ago goes first
    return exact.back().second;
  };
  {
    const std::lock_guard lock(factor_->exact_mutex);
    if (auto known = found()) return known;
  }
  LayerStack stack{{}, modulus_->layers.youngs_modulus_pa, tissue_.poisson_ratio};
  for (std::size_t j = 0; j < tissue_.grid.layers(); ++j)
    stack.thickness_m.push_back(tissue_.grid.y_m[j + 1] - tissue_.grid.y_m[j]);
  auto made = std::make_shared<const LayeredTouch>(stack, tip);
  const std::lock_guard lock(factor_->exact_mutex);
  if (auto known = found()) return known;
  if (exact.size() == kMaxTips) exact.pop_front();
  exact.emplace_back(tip, made);
  return made;
}

template <class T>
ContactAnswer SolidContact<T>::felt_answer(const Fingertip& tip, const Vector3& pose,
                                           double force_error) const {
  ContactAnswer answer = this->answer(tip, pose, force_error);
  if (!(pose[1] > 0)) return answer;
  const SolidGrid& grid = tissue_.grid;
  double of_mesh = kOfMesh;
  if (const auto exact = exact_touch(tip); exact && exact->max_m() > 0) {
    const double known_m = exact->max_m();
    const Vector3 at{pose[0], std::min(pose[1], known_m), pose[2]};
    const LayeredTouch::At layers = exact->at(at[1]).times(1 / drift_.scale);
    if (answer.state != ContactState::kContact)  // above all nodes
      touch_layers(grid, layers, pose, answer);
    else if (make_layers_exact(answer, answer_by(*layered_, tip, at, force_error), layers, pose[1] - known_m,
                               known_m))
      of_mesh =
          mesh_beyond_layers(tissue_, modulus_->layers.youngs_modulus_pa.front() / drift_.scale,
                             nearest_node(grid, pose), known(tip)->beyond_layers(nearest_node(grid, pose)));
  }
  add_solid_budget(grid, row(), tip, pose[1], of_mesh, answer);
  return answer;
}

template <class T>
ContactAnswer SolidContact<T>::answer_by(const RecycledCompliance& compliance, const Fingertip& tip,
                                         const Vector3& pose, double force_error) const {
  require_touchable(tissue_.grid, row_->solved->index, tip, pose);
  const double depth = pose[1];
  ContactAnswer answer;
  answer.solve.reason = "recycled";
  if (depth <= 0) return answer;
  const auto touch = find_contact(tissue_.grid, compliance, tip, pose, answer.iterations);
  if (!touch) return answer;
  const auto& [energy, contact] = *touch;
  const VectorXd error =
      compliance.error_between(contact.patch.unknowns, energy.sensitivity, contact.force_n);
  const double rounding = kRounding<T> + modulus_->rounding, learned = error.norm() / energy.gradient.norm();
  answer.solve.of_model = kOfDrift * drift_.shape;
  answer.solve.relative_error = learned + rounding + answer.solve.of_model;
  answer.solve.converged = learned + rounding <= force_error;
  if (!answer.solve.converged)  // more corrections would only meet rounding, or help
    answer.solve.reason = learned <= rounding / 2 ? kRoundingReason : "correction limit";
  set_forces(energy, answer);
  answer.pressure = pressure_of(tissue_.grid, row_->solved->index, contact);
  set_strain(tissue_, row_->solved->index, contact, depth, answer);
  return answer;
}

template <class T>
SolveReport SolidContact<T>::correct(const Fingertip& tip, const Vector3& pose, double force_error,
                                     std::size_t max_iterations) {
  require_touchable(tissue_.grid, row_->solved->index, tip, pose);
  feel();
  SolveReport report;
  if (pose[1] <= 0) return report;
  const Known before = known(tip);
  std::size_t iterations = 0;
  const auto touch = find_contact(tissue_.grid, *before, tip, pose, iterations);
  if (!touch) return report;
  const auto& [energy, contact] = *touch;
  const std::vector<std::size_t>& unknowns = contact.patch.unknowns;
  SolidSolver<T>& solver = factor_->solver;
  const SolidOptions options{
      .relative_error = std::max(kCorrectionShare * force_error, 2 * modulus_->rounding),
      .max_iterations = max_iterations};
  solver.use(modulus_);
  solver.at(row_->solved);
  auto next = std::make_shared<RecycledCompliance>(*before);
  const auto learn = [&](const SolidSolution& solved) {
    if (solved.reason == StopReason::kNotFinite || solved.reason == StopReason::kIndefinite)
      throw std::domain_error(fmt::format("contact: the solver broke down ({})", to_string(solved.reason)));
    next->add(unknowns, solved.force_n, solver.excess());
    report.iterations += solved.iterations;
    report.reason = to_string(solved.reason);
  };
  // Solved under what the forces change by, too, coarsely, the tangent is exact. For the surface's patches
  // the guess is good enough; rows below may go through a lump.
  const bool node = tip.shape == FingertipShape::kNode;
  if (node || row_->solved->index > 0)
    for (const Index q : {0, 1, 2})
      if (!node || q != 1)
        learn(solver.load(
            unknowns, energy.sensitivity.col(q),
            {.relative_error = std::min(kMinForTangent, kTangentShare * options.relative_error)}));
  if (node) {  // the shape of its forces is known
    learn(solver.load(unknowns, contact.force_n, options));
  } else {  // The block is periodic; the contact's surface is not.
    learn(solver.push(contact.patch, contact.w_m - before->wider_m(unknowns, contact.force_n), options));
  }
  ++corrections_;
  const std::lock_guard lock(mutex_);
  (tip.friction == Friction::kStuck ? stuck_ : frictionless_) = std::move(next);
  return report;
}

template <class T>
ContactAnswer SolidContact<T>::touch(const Fingertip& tip, const Vector3& pose,
                                     const SolidContactOptions& options) {
  ContactAnswer answer = this->answer(tip, pose, options.force_error);
  std::size_t iterations = 0;
  for (std::size_t corrections = 0; corrections < options.max_corrections; ++corrections) {
    if (answer.solve.converged || answer.solve.reason == kRoundingReason) break;
    const SolveReport corrected = correct(tip, pose, options.force_error);
    iterations += corrected.iterations;
    answer = this->answer(tip, pose, options.force_error);
    answer.solve.iterations = iterations;
    if (answer.solve.converged) answer.solve.reason = corrected.reason;
  }
  return answer;
}

template <class T>
VectorXd SolidContact<T>::moved_m(const Fingertip& tip, const Vector3& pose,
                                  const std::vector<std::size_t>& nodes) const {
  require_touchable(tissue_.grid, row_->solved->index, tip, pose);
  const Known compliance = known(tip);
  std::size_t iterations = 0;
  const auto touch = pose[1] > 0 ? find_contact(tissue_.grid, *compliance, tip, pose, iterations)
                                 : std::optional<SolidTouch>();
  if (!touch) return VectorXd::Zero(static_cast<Index>(nodes.size()));
  return compliance->moved_m(nodes, touch->contact.patch.unknowns, touch->contact.force_n);
}

// The force grows about as a power of the depth: a line through the newest two in their logarithms.
template <class T>
std::vector<NodalPressure> SolidContact<T>::layered_pressure(const Fingertip& tip, const Vector3& pose,
                                                             double force_n) const {
  constexpr double kEqual = 1e-6;
  constexpr int kMaxTries = 10;  // 4 or 5 do
  Vector3 at = pose;
  double power = 1.5, before_n = 0, before_m = 0;  // of a round tip
  for (int tries = 0; tries < kMaxTries; ++tries) {
    require_touchable(tissue_.grid, row_->solved->index, tip, at);
    std::size_t iterations = 0;
    const auto touch = find_contact(tissue_.grid, *layered_, tip, at, iterations);
    if (!touch) break;
    const double force = force_of(tissue_.grid, touch->contact);
    if (std::abs(force - force_n) <= kEqual * force_n)
      return pressure_of(tissue_.grid, row_->solved->index, touch->contact);
    if (tries > 0) power = std::log(force / before_n) / std::log(at[1] / before_m);
    if (!(power > 0)) break;
    before_n = force, before_m = at[1];
    at[1] *= std::pow(force_n / force, 1 / power);
  }
  throw std::domain_error(
      fmt::format("contact: layered tissue bears {:.4g} N at no depth that was found", force_n));
}

template class SolidContact<float>;
template class SolidContact<double>;

}  // namespace teletact::service
