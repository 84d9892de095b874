#include "service/scene/touch_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "service/contact/fingertip.h"
#include "service/device/device.h"

namespace teletact::service {

namespace {

void check_fingertip(const Fingertip& tip, const Limits& limits) {
  const auto check_length = [&](const char* field, double value_m, double least_m) {
    if (value_m >= least_m && value_m <= limits.most_tip_m) return;
    throw std::invalid_argument(
        fmt::format("{}: {} m is not within [{}, {}]", field, value_m, least_m, limits.most_tip_m));
  };
  switch (tip.shape) {
    case FingertipShape::kNode:
      // A Gaussian is cut at three standard deviations or so.
      if (!(tip.footprint_m >= 0 && 3 * tip.footprint_m <= limits.most_tip_m))
        throw std::invalid_argument(fmt::format("open.fingertip.footprint_m: {} m is not within [0, {:.4f}]",
                                                tip.footprint_m, limits.most_tip_m / 3));
      return;
    case FingertipShape::kFlatPunch:
      check_length("open.fingertip.half_width_m", tip.half_width_m, limits.least_tip_m);
      check_length("open.fingertip.radius_m", tip.radius_m, 0);
      return;
    case FingertipShape::kRoundedTip:
      check_length("open.fingertip.radius_m", tip.radius_m, limits.least_tip_m);
      return;
  }
}

// Half of the width that a contact asks for.
double touched_m(const Fingertip& tip, double indentation_m) {
  if (tip.shape == FingertipShape::kNode) return 3 * tip.footprint_m;
  return reach_m(tip, indentation_m, ContactOptions{}.candidate_margin * indentation_m);
}

void fail(TouchAnswer& answer, const char* why) {
  answer.contact = {};
  answer.status = TouchStatus::kFailed;
  answer.warning = why;
}

bool finite(const ContactAnswer& c) {
  const auto all = [](const auto& values) {
    return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
  };
  return all(c.force_n) && all(c.tangent_n_m) && std::isfinite(c.energy_j);
}

}  // namespace

TouchSession::TouchSession(std::shared_ptr<Scene> scene, TouchOptions options, std::shared_ptr<Device> device)
    : scene_(std::move(scene)),
      options_(options),
      device_(std::move(device)),
      line_(scene_->line_near(options.line_y_m)) {
  check_fingertip(options_.fingertip, scene_->limits());
  scene_->use_line(line_);
}

void TouchSession::use(const std::shared_ptr<Device>& device) {
  if (device == device_) return;
  device_ = device;
  if (options_.path == SolvePath::kPcg) window_.reset(), compliance_.reset();
}

TouchSession::~TouchSession() {
  scene_->leave_line(line_);
}

double TouchSession::line_y_m() const {
  return scene_->lines_m()[line_];
}

// In what way the pose is not one of a finger on this tissue; empty when it is.
std::string TouchSession::outside(double x_m, double y_m) const {
  const SceneGeometry& g = scene_->geometry();
  if (x_m < 0 || x_m > g.width_m)
    return fmt::format("pose.position_m[0]: {:.4g} m is beside the tissue, which reaches from 0 to {} m", x_m,
                       g.width_m);
  if (y_m >= g.depth_m)
    return fmt::format(
        "pose.position_m[1]: {:.4g} m is deeper than the tissue, which is {} m; lift the finger", y_m,
        g.depth_m);
  return "";
}

TouchAnswer TouchSession::solve(double x_m, double y_m) {
  if (!std::isfinite(x_m) || !std::isfinite(y_m))
    throw std::invalid_argument("pose.position_m: not finite; send numbers in metres");
  TouchAnswer answer;
  answer.warning = outside(x_m, y_m);
  const auto snapshot = scene_->snapshot();
  answer.covered = snapshot->covered_around(x_m);
  const auto window =
      answer.warning.empty() ? snapshot->window_at(x_m, window_ ? window_->id : 0, kHysteresisM) : nullptr;
  if (!window) {
    window_.reset(), compliance_.reset();
    answer.status = TouchStatus::kNotCovered;
    answer.path = SolvePath::kAuto;
    return answer;
  }
  answer.window_id = window->id;
  try {
    if (!enter(window, *snapshot)) {
      answer.status = TouchStatus::kPreparing;
      answer.path = SolvePath::kAuto;
      answer.warning = fmt::format(
          "the touched line, {:.4f} m deep, is being made ready in this window; hold the finger above",
          line_y_m());
      return answer;
    }
    answer.model_version = window_->version;
    answer.taken_in = window_->taken_in;
    for (const std::string_view flag : snapshot->flags_of(*window_)) answer.window_flags.emplace_back(flag);
    solve_contact_into(answer, *window_, x_m, y_m);
    judge(answer, *window_, *snapshot, {x_m, y_m - line_y_m()});
    if (answer.contact.state == ContactState::kNoContact) answer.foreseen = foresee(*window_, *snapshot, x_m);
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

// False while the window's line is being made. Until a newer model of the same window has it, the one before
// answers.
bool TouchSession::enter(const std::shared_ptr<const WindowModel>& window, const SceneSnapshot& snapshot) {
  if (window == window_) return true;
  const TouchWork& prepare = scene_->touch_work();
  const bool by_pcg = options_.path == SolvePath::kPcg;
  if (window_ && window_->id != window->id) window_.reset(), compliance_.reset();
  auto compliance = window->lines->get(line_, by_pcg ? device_ : nullptr, prepare, options_.client);
  if (!compliance) return window_ != nullptr;
  window_ = window, compliance_ = std::move(compliance);
  if (by_pcg || !prepare) return true;
  for (const auto& next : snapshot.windows)  // where the finger may go from here
    if (next != window && adjoin(*next, *window)) try {
        next->lines->get(line_, nullptr, prepare, options_.client);
      } catch (const std::exception&) {  // said when the finger is there
      }
  return true;
}

// Solves columns within `reach_m` of x, the nearest first, for no longer than about this; false when some are
// left.
bool TouchSession::prepare(const WindowModel& window, double x_m, double reach_m,
                           std::chrono::milliseconds time) {
  const auto until = std::chrono::steady_clock::now() + time;
  const std::vector<double>& columns_m = window.model->grid().x_m;
  const ColumnRange touchable = window.model->touchable_columns();
  std::vector<std::size_t> nodes;
  for (std::size_t i = touchable.first; i <= touchable.last; ++i)
    if (std::abs(columns_m[i] - x_m) <= reach_m) nodes.push_back(i);
  std::sort(nodes.begin(), nodes.end(), [&](std::size_t a, std::size_t b) {
    return std::abs(columns_m[a] - x_m) < std::abs(columns_m[b] - x_m);
  });
  return compliance_->prepare(nodes, options_.fingertip.friction == Friction::kStuck, until);
}

// Nothing is owed: without room for more the finger finds less ready.
void TouchSession::look_ahead(const WindowModel& window, double x_m) {
  try {
    prepare(window, x_m, kWidestReachM, kAhead);
  } catch (const MemoryRefused&) {
  }
}

void TouchSession::solve_contact_into(TouchAnswer& answer, const WindowModel& window, double x_m,
                                      double y_m) {
  answer.path = options_.path == SolvePath::kPcg ? SolvePath::kPcg : SolvePath::kCompliance;
  const ContactPose pose{x_m, y_m - line_y_m()};
  const bool by_pcg = answer.path == SolvePath::kPcg;
  if (by_pcg && pose.indentation_m > 0 &&
      !prepare(window, x_m, touched_m(options_.fingertip, pose.indentation_m), kLongestSolve))
    throw std::runtime_error(
        "columns of the contact are still being solved; hold the finger above, or use "
        "the compliance");
  answer.contact = solve_contact(*window.model, line_, *compliance_, options_.fingertip, pose);
  if (by_pcg) look_ahead(window, x_m);
  if (answer.contact.state == ContactState::kNoContact) answer.path = SolvePath::kAuto;
}

double TouchSession::measured_share(const StitchedMap& map, double x_m) const {
  const double above_m = std::max(0.0, line_y_m() - kFeltDepthM / 2);
  const double below_m = std::min(scene_->geometry().depth_m, above_m + kFeltDepthM);
  return map.measured_share(x_m - kWidestReachM / 2, x_m + kWidestReachM / 2, above_m, below_m);
}

// Why a contact is not to be trusted; empty when it is.
std::string TouchSession::doubt(const ContactAnswer& c, const WindowModel& window,
                                const SceneSnapshot& snapshot, double x_m) const {
  const double measured = snapshot.map ? measured_share(*snapshot.map, x_m) : 1;
  if (!c.solve.converged || !(c.solve.relative_error <= kTrustedForceError))
    return fmt::format("the solver stopped ({}) with a force error of {:.2g}", c.solve.reason,
                       c.solve.relative_error);
  if (window.evidence)
    for (const std::string& warning : window.evidence->warnings)
      if (effect_of(flag_of(warning)) == FlagEffect::kDegrade) return "of the window: " + warning;
  if (measured < kTrustedShare)
    return fmt::format("only {:.0f} % of the tissue under the finger was measured, the rest is extended",
                       100 * measured);
  return "";
}

// What is wrong with the mesh under a pressed tip; empty when nothing is. A tip that only begins to touch is
// judged as pressed lightly: it overlaps few nodes of any mesh.
std::string TouchSession::coarseness(const WindowModel& window, const ContactPose& pose) const {
  const Fingertip& tip = options_.fingertip;
  if (tip.shape == FingertipShape::kNode || pose.indentation_m <= 0) return "";
  const std::vector<double>& columns_m = window.model->grid().x_m;
  const double reach = reach_m(tip, std::max(pose.indentation_m, kForeseenM), 0);
  double widest_m = 0;
  for (std::size_t i = 0; i + 1 < columns_m.size(); ++i)
    if (columns_m[i + 1] > pose.x_m - reach && columns_m[i] < pose.x_m + reach)
      widest_m = std::max(widest_m, columns_m[i + 1] - columns_m[i]);
  const double curved = tip.shape == FingertipShape::kFlatPunch ? reach - tip.half_width_m : reach;
  if (curved >= kLeastSpacings * widest_m) return "";
  return fmt::format(
      "the mesh is too coarse for this tip: nodes {:.2g} mm apart where its curved part spans {:.2g} mm a "
      "side; "
      "the force depends on where it stands between them, use a finer grid or a wider tip",
      1e3 * widest_m, 1e3 * curved);
}

void TouchSession::judge(TouchAnswer& answer, const WindowModel& window, const SceneSnapshot& snapshot,
                         const ContactPose& pose) const {
  const ContactAnswer& c = answer.contact;
  if (!finite(c)) throw std::runtime_error("the contact solve gave a force that is not finite");
  // These are said, but no reason to fade the force: it is the linear model's on this mesh, and continuous.
  answer.warning = coarseness(window, pose);
  if (c.state == ContactState::kNoContact) return;
  const auto say = [&answer](const std::string& words) {
    answer.warning += (answer.warning.empty() ? "" : "; ") + words;
  };
  if (const std::string why = doubt(c, window, snapshot, pose.x_m); !why.empty()) {
    answer.warning = why;
    answer.status = TouchStatus::kDegraded;
    return;
  }
  if (c.strain_beyond_linear)
    say(fmt::format("strain {:.2f} under the finger is beyond linear elasticity", c.largest_strain));
  if (!answer.window_flags.empty())
    say(fmt::format("the window's estimate is doubtful: {}; the scene says why",
                    fmt::join(answer.window_flags, ", ")));
}

// By PCG only where the columns are there by now: nobody waits for it.
std::optional<ForeseenTouch> TouchSession::foresee(const WindowModel& window, const SceneSnapshot& snapshot,
                                                   double x_m) try {
  if (options_.path == SolvePath::kPcg &&
      !prepare(window, x_m, touched_m(options_.fingertip, kForeseenM), std::chrono::milliseconds(0)))
    return std::nullopt;
  ForeseenTouch touch{
      x_m, line_y_m() + kForeseenM,
      solve_contact(*window.model, line_, *compliance_, options_.fingertip, {x_m, kForeseenM})};
  if (touch.contact.state == ContactState::kNoContact || !finite(touch.contact) ||
      !doubt(touch.contact, window, snapshot, x_m).empty())
    return std::nullopt;
  return touch;
} catch (const std::exception&) {  // the model's limits: nothing is foreseen, the answer stands
  return std::nullopt;
}

}  // namespace teletact::service
