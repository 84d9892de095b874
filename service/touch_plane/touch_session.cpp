#include "service/touch_plane/touch_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "service/base/choices.h"
#include "service/base/force_budget.h"
#include "service/device/device.h"
#include "service/scene/slices.h"
#include "service/touch_plane/scene_errors.h"

namespace teletact::service {
namespace {

constexpr const char* kStillSolved =
    "columns of the contact are still being solved; hold the finger above, or use the compliance";

// A finger that would be faster was put down elsewhere.
constexpr double kFastestMS = 0.5;

bool all_finite(std::span<const double> values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
}

double distance_m(const TouchPose& from, const TouchPose& to) {
  const auto& [x, y, z] = from.position_m;
  const auto& [to_x, to_y, to_z] = to.position_m;
  return std::hypot(to_x - x, to_y - y, to_z - z);
}

void fail(TouchAnswer& answer, const char* why) {
  answer.contact = {};
  answer.status = TouchStatus::kFailed;
  answer.warning = why;
}

bool finite(const ContactAnswer& c) {
  const auto known = [](const NodalPressure& p) {
    return all_finite(p.position_m) && std::isfinite(p.pressure_pa) && all_finite(p.traction_pa);
  };
  return all_finite(c.force_n) && all_finite(c.tangent_n_m) && std::isfinite(c.energy_j) &&
         std::all_of(c.pressure.begin(), c.pressure.end(), known);
}

}  // namespace

bool trusted_meanwhile(const SolveReport& solve) {
  return solve.improving && solve.relative_error - solve.of_model <= choices::kTrustedMeanwhile;
}

TouchSession::TouchSession(std::shared_ptr<Scene> scene, TouchOptions options, std::shared_ptr<Device> device)
    : scene_(std::move(scene)),
      options_(canonical(std::move(options))),
      layer_(scene_->layer_near(options_.layer_depth_m)),
      way_{.path = options_.path, .device = std::move(device), .client = options_.client} {
  const auto snapshot = scene_->snapshot();
  const bool solid = !snapshot->windows.empty() && snapshot->windows.front()->region.z;
  check(options_, layer_, scene_->limits());
  way_.shares = has_shares(options_, layer_, solid);
  if (way_.shares) {  // laws are of each tolerance
    way_.tolerance = options_.tolerance;
    way_.pressure = options_.pressure;
    way_.planner = std::make_shared<Planner>();
  }
  scene_->models().check(solid, options_.fingertip, layer_, way_);
  scene_->use_layer(layer_);
}

TouchSession::~TouchSession() {
  scene_->leave_layer(layer_);
}

void TouchSession::use(const std::shared_ptr<Device>& device) {
  if (device == way_.device) return;
  way_.device = device;
  if (touched_ && touched_->device()) leave_window();
}

// In what way the position is not one of a finger on this tissue; empty when it is.
std::string TouchSession::outside(const Vector3& position_m) const {
  const SceneGeometry& g = scene_->geometry();
  if (position_m[0] < 0 || position_m[0] > g.width_m)
    return fmt::format("pose.position_m[0]: {:.4g} m is beside the tissue, which reaches from 0 to {} m",
                       position_m[0], g.width_m);
  if (position_m[1] >= g.depth_m)
    return fmt::format(
        "pose.position_m[1]: {:.4g} m is deeper than the tissue, which is {} m; lift the finger",
        position_m[1], g.depth_m);
  return "";
}

TouchAnswer TouchSession::solve(const Vector3& position_m, const MayEnter& may_enter) {
  if (!all_finite(position_m))
    throw std::invalid_argument("pose.position_m: not finite; send numbers in metres");
  const double x_m = position_m[0];
  TouchAnswer answer;
  answer.warning = outside(position_m);
  const auto snapshot = scene_->snapshot();
  answer.covered = snapshot->covered_around(x_m);
  auto window = answer.warning.empty()
                    ? snapshot->window_at(x_m, window_ ? window_->id : 0, choices::kHandOver)
                    : nullptr;
  const double z_m = position_m[2];
  if (window && window->region.z && !window->region.z->holds(z_m)) {
    answer.warning = fmt::format(
        "pose.position_m[2]: {:.4g} m is beside the tissue, which reaches from {:.4g} to {:.4g} m along z",
        z_m, window->region.z->begin_m, window->region.z->end_m);
    window = nullptr;
  }
  if (!window) {
    leave_window();
    answer.status = TouchStatus::kNotCovered;
    return answer;
  }
  answer.window_id = window->id;
  if (snapshot->modulus) {  // of the newest slices; newtons excuse a light touch, and it may be pressed next
    const auto& asked = options_.tolerance;
    const TouchPose pose{{x_m, position_m[1] - layer_.depth_m, z_m}};
    answer.wish = wished_slice(*snapshot->modulus, felt_by(options_.fingertip, layer_, pose),
                               asked ? std::optional(asked->relative) : std::nullopt);
  }
  try {
    TouchPose pose{{x_m, position_m[1] - layer_.depth_m, position_m[2]}};
    motion_.see(pose, FingerMotion::Clock::now());
    if (!enter(window, *snapshot, pose, may_enter)) {
      answer.status = TouchStatus::kPreparing;
      answer.warning = fmt::format(
          "the touched layer, {:.4f} m deep, is being made ready in this window; hold the finger above",
          layer_.depth_m);
      return answer;
    }
    answer.model_version = window_->version;
    answer.taken_in = window_->taken_in;
    if (window == window_) seen_ = snapshot;
    for (const std::string_view flag : seen_->flags_of(*window_)) answer.window_flags.emplace_back(flag);
    touch_into(answer, pose);
    judge(answer, *seen_, pose);
    if (answer.contact.state == ContactState::kNoContact) answer.foreseen = foresee(*seen_, pose);
  } catch (const DeviceMemoryError& error) {  // says nothing of the device
    fail(answer, error.what());
  } catch (const DeviceError& error) {
    fail(answer, error.what());
    answer.device_failed = true;
  } catch (const std::exception& error) {  // the model's or the solver's limits, not the client's fault
    fail(answer, error.what());
  }
  return answer;
}

std::shared_ptr<const ContactLaw> TouchSession::law_of(const WindowModel& window, const Vector3& near_m) const
    try {
  if (!ContactLaws::has(layer_, way_, window.region)) return nullptr;
  TouchWay way = way_;
  way.law = true;
  const auto touched = window.model->layer(layer_, way, scene_->touch_work());
  if (!touched) return nullptr;
  return window.model->laws().get(options_.fingertip, layer_, way, touched, window.region, near_m,
                                  scene_->touch_work());
} catch (const std::exception&) {  // said by the answer when the finger is there
  return nullptr;
}

void TouchSession::leave_window() {
  window_.reset(), touched_.reset(), seen_.reset(), arriving_.reset();
  at_.reset(), before_.reset(), trusted_.reset();
}

// False while the window's layer is being made ready. Until a newer model of the same window has it, and
// would answer the finger well, the one before answers.
bool TouchSession::enter(const std::shared_ptr<const WindowModel>& window, const SceneSnapshot& snapshot,
                         const TouchPose& pose, const MayEnter& may_enter) {
  if (window == window_) return true;
  const TouchWork& work = scene_->touch_work();
  if (window_ && window_->id != window->id) leave_window();
  auto layer =
      arriving_ && arriving_->window == window ? arriving_->layer : window->model->layer(layer_, way_, work);
  if (!layer) return window_ != nullptr;
  arriving_ = {window, layer, arriving_ ? arriving_->since : TouchedLayer::Clock::now()};
  // This order: may_enter() counts on being heeded.
  if (window_ && work && !arrived(pose)) return true;
  if (window_ && !may_enter(*window)) return true;
  window_ = window, touched_ = std::move(layer), arriving_.reset(), trusted_.reset();
  if (touched_->device() || !work) return true;
  for (const auto& next : snapshot.windows)  // where the finger may go from here
    if (next != window && adjoin(*next, *window)) try {
        next->model->layer(layer_, way_, work);
      } catch (const std::exception&) {  // said when the finger is there
      }
  return true;
}

// Whether a newer model may answer here from now on: where it does well, where nobody makes it do so beside,
// and some time after the first was ready.
bool TouchSession::arrived(const TouchPose& pose) try {
  const auto job = arriving_->layer->wanted(options_.fingertip, pose, 0);
  if (!job || job->error <= choices::kTrustedMeanwhile || !std::isfinite(job->error)) return true;
  job->work(TouchedLayer::Clock::now());
  return TouchedLayer::Clock::now() - arriving_->since >= choices::kArrives;
} catch (const std::exception&) {  // said by the answer
  return true;
}

void TouchSession::look_ahead() try {
  if (!touched_ || !at_) return;
  TouchPose next = *at_;
  for (std::size_t k = 0; before_ && k < 3; ++k)
    next.position_m[k] += at_->position_m[k] - before_->position_m[k];
  if (const auto job = touched_->wanted(options_.fingertip, next, choices::kWidestReach))
    job->work(TouchedLayer::Clock::now() + choices::kAhead);
} catch (const DeviceMemoryError&) {  // says nothing of the device
} catch (const DeviceError&) {
  throw;
} catch (const std::exception&) {
}

// Whether it pressed near by a short time before: a wait would take away the force that is felt.
bool TouchSession::presses_on(const TouchPose& pose) const {
  return at_ && indentation_m(layer_, *at_) > 0 &&
         TouchedLayer::Clock::now() - at_time_ < choices::kPressesOn &&
         distance_m(*at_, pose) <= choices::kPressesOnM;
}

// Whether it may have come from where it was answered well a short time before.
bool TouchSession::is_followed(const TouchPose& pose) const {
  if (!trusted_) return false;
  const auto passed = TouchedLayer::Clock::now() - trusted_time_;
  const double could_m =
      std::min(choices::kPressesOnM, kFastestMS * std::chrono::duration<double>(passed).count());
  return passed < choices::kTrustLasts && distance_m(*trusted_, pose) <= could_m;
}

// By what is known; a finger that is put down waits for what that lacks.
ContactAnswer TouchSession::answered(const TouchPose& pose) {
  const Fingertip& tip = options_.fingertip;
  ContactAnswer answer = touched_->answer(tip, pose);
  if (!(indentation_m(layer_, pose) > 0)) return answer;
  auto job = touched_->wanted(tip, pose, 0);
  if (!job && !std::isfinite(answer.solve.relative_error))
    answer = touched_->answer(tip, pose);  // found by now
  const auto goes_on = [&] {
    if (!std::isfinite(answer.solve.relative_error)) return false;
    return is_followed(pose) || (job->wait != JobWait::kFirst && presses_on(pose));
  };
  if (job && job->wait != JobWait::kBeside && !goes_on()) {
    const bool done = job->work(TouchedLayer::Clock::now() + choices::kLongestSolve);
    job = touched_->wanted(tip, pose, 0);
    answer = touched_->answer(tip, pose);
    if (!done && job && job->wait == JobWait::kFirst) throw std::runtime_error(kStillSolved);
  }
  if (!std::isfinite(answer.solve.relative_error)) throw std::runtime_error(kStillSolved);
  if (job) job->work(TouchedLayer::Clock::now());
  return answer;
}

void TouchSession::touch_into(TouchAnswer& answer, const TouchPose& pose) {
  answer.path = options_.path;  // should it fail
  answer.contact = answered(pose);
  const ContactAnswer& c = answer.contact;
  answer.path = c.state == ContactState::kContact ? c.path : SolvePath::kAuto;
  before_ = std::exchange(at_, pose), at_time_ = TouchedLayer::Clock::now();
  if (c.path != SolvePath::kShares &&
      (c.solve.converged || c.solve.relative_error - c.solve.of_model <= choices::kTrustedMeanwhile))
    trusted_ = pose, trusted_time_ = at_time_;
}

double TouchSession::measured_share(const StitchedMap& map, double x_m) const {
  const double above_m = std::max(0.0, layer_.depth_m - choices::kFeltDepth / 2);
  const double below_m = std::min(scene_->geometry().depth_m, above_m + choices::kFeltDepth);
  return map.measured_share(x_m - choices::kWidestReach / 2, x_m + choices::kWidestReach / 2, above_m,
                            below_m);
}

// Why a contact is not to be trusted; empty when it is.
std::string TouchSession::doubt(const ContactAnswer& c, const SceneSnapshot& snapshot,
                                const TouchPose& pose) const {
  const auto& [x_m, y_m, z_m] = pose.position_m;
  const double measured = snapshot.map ? measured_share(*snapshot.map, x_m) : 1;
  const bool meanwhile = trusted_meanwhile(c.solve);
  if (!c.solve.converged && !meanwhile)
    return fmt::format("the solver stopped ({}) with a force error of {:.2g}", c.solve.reason,
                       c.solve.relative_error);
  if (!(c.solve.of_model <= choices::kTrustedModelError))
    return fmt::format(
        "the tissue's layers changed: the force may be off by {:.2g} until they are computed again",
        c.solve.of_model);
  if (!meanwhile && !(c.solve.relative_error - c.solve.of_model <= choices::kTrustedForceError))
    return fmt::format(
        "the solve may be off by up to {:.2g} of the force; nu near 1/2 beside high contrast does this",
        c.solve.relative_error);
  if (const auto& asked = options_.tolerance; asked && !c.budget.terms().empty()) {
    const double force_n = std::hypot(c.force_n[0], c.force_n[1], c.force_n[2]);
    if (!asked->allows(c.budget, force_n))
      return fmt::format(
          "the model may put the force off by {:.2g} of it (solver {:.2g}, mesh {:.2g}, finite strain "
          "{:.2g}, left out {:.2g}, no plane {:.2g}, tissue beside {:.2g}), more than was asked for",
          c.budget.of_model(), c.budget.relative(ErrorTerm::kSolver), c.budget.relative(ErrorTerm::kMesh),
          c.budget.relative(ErrorTerm::kFiniteStrain), c.budget.relative(ErrorTerm::kModel),
          c.budget.relative(ErrorTerm::kDimension), c.budget.relative(ErrorTerm::kContext));
  }
  if (window_->evidence)
    for (const std::string& warning : window_->evidence->warnings)
      if (degrades(flag_of(warning))) return "of the window: " + warning;
  if (measured < choices::kTrustedShare)
    return fmt::format("only {:.0f} % of the tissue under the finger was measured, the rest is extended",
                       100 * measured);
  if (const double away_m = snapshot.modulus ? from_slices_m(*snapshot.modulus, z_m) : 0;
      away_m > choices::kSliceReach)
    return fmt::format("the nearest slice is {:.1f} mm away along z: the tissue here is interpolated",
                       1e3 * away_m);
  return "";
}

void TouchSession::judge(TouchAnswer& answer, const SceneSnapshot& snapshot, const TouchPose& pose) const {
  const ContactAnswer& c = answer.contact;
  if (!finite(c)) throw std::runtime_error("the contact solve gave a force that is not finite");
  // These are said, but no reason to fade the force: it is the linear model's on this mesh, and continuous.
  answer.warning = c.remark;
  if (c.state == ContactState::kNoContact) return;
  const SceneErrors errors = scene_errors(*scene_, snapshot, *window_, options_.fingertip, layer_, pose);
  answer.log_deviation = errors.log_deviation;
  errors.add_to(answer.contact);
  const auto say = [&answer](const std::string& words) {
    answer.warning += (answer.warning.empty() ? "" : "; ") + words;
  };
  if (const std::string why = doubt(c, snapshot, pose); !why.empty()) {
    answer.warning = why;
    answer.status = TouchStatus::kDegraded;
    return;
  }
  if (const double off = ForceBudget::kOf95 * answer.contact.budget.relative(ErrorTerm::kModel);
      options_.path != SolvePath::kAuto && off > Tolerance{}.relative)
    say(fmt::format("the model that was asked for may put the force off by {:.2g} of it", off));
  if (errors.beyond_end > Tolerance{}.relative)
    say(fmt::format(
        "{:.0f} mm from here ends the tissue that was given: a lump beyond may change the force by {:.2g}",
        1e3 * errors.end_away_m, errors.beyond_end));
  if (c.strain_beyond_linear)
    say(fmt::format("strain {:.2f} under the finger is beyond linear elasticity", c.largest_strain));
  if (!answer.window_flags.empty())
    say(fmt::format("the window's estimate is doubtful: {}; the scene says why",
                    fmt::join(answer.window_flags, ", ")));
}

// By what is known now: nobody waits for it.
std::optional<ForeseenTouch> TouchSession::foresee(const SceneSnapshot& snapshot,
                                                   const TouchPose& above) try {
  const TouchPose pose = at_indentation(layer_, above, choices::kLightTouch);
  const auto& [x_m, y_m, z_m] = pose.position_m;
  ForeseenTouch touch{{x_m, layer_.depth_m + y_m, z_m}, touched_->answer(options_.fingertip, pose)};
  scene_errors(*scene_, snapshot, *window_, options_.fingertip, layer_, pose).add_to(touch.contact);
  if (touch.contact.state == ContactState::kNoContact || !finite(touch.contact) ||
      !doubt(touch.contact, snapshot, pose).empty())
    return std::nullopt;
  return touch;
} catch (const std::exception&) {  // the model's limits: nothing is foreseen, the answer stands
  return std::nullopt;
}

}  // namespace teletact::service
