#include "service/scene/scene.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "service/scene/errors.h"

namespace teletact::service {

void WindowModel::set_model(std::shared_ptr<const TissueModel> made) {
  model = std::move(made);
  lines = std::make_shared<PreparedLines>(model);
}

std::shared_ptr<const WindowModel> SceneSnapshot::window_at(double x_m, std::uint64_t current,
                                                            double hysteresis_m) const {
  std::shared_ptr<const WindowModel> best;
  double best_margin_m = -1;
  for (const auto& window : windows) {
    if (x_m < window->begin_m || x_m >= window->end_m) continue;
    const double margin_m = std::min(x_m - window->begin_m, window->end_m - x_m);
    if (margin_m > best_margin_m) best = window, best_margin_m = margin_m;
  }
  if (!best) return nullptr;
  for (const auto& window : windows)
    if (window->id == current && x_m >= window->begin_m - hysteresis_m && x_m < window->end_m + hysteresis_m)
      return window;
  return best;
}

bool adjoin(const WindowModel& a, const WindowModel& b) {
  return a.begin_m - Scene::kSameWindowM < b.end_m && a.end_m + Scene::kSameWindowM > b.begin_m;
}

bool SceneSnapshot::lone(const WindowModel& window) const {
  return map && std::none_of(windows.begin(), windows.end(), [&window](const auto& other) {
           return other->id != window.id && adjoin(*other, window);
         });
}

std::vector<std::string_view> SceneSnapshot::flags_of(const WindowModel& window) const {
  std::vector<std::string_view> flags;
  if (window.evidence)
    for (const std::string& warning : window.evidence->warnings) flags.push_back(flag_of(warning));
  if (lone(window)) flags.emplace_back(kLoneFlag);
  return flags;
}

Covered SceneSnapshot::covered_around(double x_m) const {
  constexpr double kAdjoiningM = 1e-6;  // rounding of positions and widths
  Covered covered{x_m, x_m};
  bool inside = false;
  double begin_m = 0, end_m = 0;
  for (const auto& window : windows) {
    if (windows.front() == window || window->begin_m > end_m + kAdjoiningM)
      begin_m = window->begin_m, end_m = begin_m;
    end_m = std::max(end_m, window->end_m);
    inside = x_m >= begin_m && x_m < end_m;
    if (inside) covered = {begin_m, end_m};
  }
  return covered;
}

namespace {

StripOptions held_by(const MemoryAccount& account) {
  StripOptions options;
  options.account = account;
  return options;
}

Charge charged(const std::optional<ExplicitModulus>& e, const MemoryAccount& account) {
  if (!e) return {};
  const std::size_t values = e->x_m.size() + e->y_m.size() + e->youngs_modulus_pa.size();
  return account.charge(Place::kHost, "maps", values * sizeof(double));
}

}  // namespace

Scene::Scene(std::string id, const SceneGeometry& geometry, std::shared_ptr<VersionCounter> versions,
             const Limits& limits, const MemoryAccount& account)
    : id_(std::move(id)),
      geometry_(geometry),
      lines_m_(strip_lines(geometry)),
      strip_(held_by(account)),
      versions_(std::move(versions)),
      limits_(limits) {
  auto empty = std::make_shared<SceneSnapshot>();
  empty->map = std::make_shared<const StitchedMap>(geometry_, account);
  snapshot_ = empty;
}

namespace {

std::shared_ptr<const TissueModel> explicit_model(const SceneGeometry& geometry, const ExplicitModulus& e,
                                                  const MemoryAccount& account) {
  TissueModelOptions options;
  options.touch_begin_m = e.x_m.front();
  options.touch_end_m = e.x_m.back();
  options.thickness_m = geometry.thickness_m;
  options.account = account;
  return std::make_shared<const TissueModel>(TissueGrid{e.x_m, e.y_m},
                                             Material{e.youngs_modulus_pa, geometry.poisson_ratio},
                                             geometry.supports, options);
}

}  // namespace

Scene::Scene(std::string id, const SceneGeometry& geometry, ExplicitModulus modulus,
             std::shared_ptr<VersionCounter> versions, const Limits& limits, const MemoryAccount& account)
    : id_(std::move(id)),
      geometry_(geometry),
      explicit_charge_(charged(modulus, account)),
      explicit_(std::move(modulus)),
      lines_m_(explicit_->y_m),
      strip_(held_by(account)),
      versions_(std::move(versions)),
      limits_(limits),
      next_window_id_(2) {
  auto window = std::make_shared<WindowModel>();
  window->id = 1;
  window->taken_in = std::chrono::steady_clock::now();
  window->begin_m = explicit_->x_m.front();
  // The last column belongs to the tissue too.
  window->end_m = std::nextafter(explicit_->x_m.back(), HUGE_VAL);
  window->set_model(explicit_model(geometry_, *explicit_, account));
  window->version = versions_->next();
  auto snapshot = std::make_shared<SceneSnapshot>();
  snapshot->version = window->version;
  snapshot->windows.push_back(std::move(window));
  snapshot_ = snapshot;
}

Scene::Scene(const SceneRecord& record, std::shared_ptr<VersionCounter> versions, const Limits& limits,
             const MemoryAccount& account)
    : id_(record.id),
      geometry_(record.geometry),
      explicit_charge_(charged(record.explicit_modulus, account)),
      explicit_(record.explicit_modulus),
      lines_m_(explicit_ ? explicit_->y_m : strip_lines(geometry_)),
      strip_(held_by(account)),
      versions_(std::move(versions)),
      limits_(limits),
      next_window_id_(record.next_window_id) {
  auto snapshot = std::make_shared<SceneSnapshot>();
  snapshot->version = record.version;
  if (!explicit_) {
    auto map = std::make_shared<StitchedMap>(geometry_, account);
    map->restore(record.map_modulus_pa, record.map_states, record.map_log_deviation);
    snapshot->map = map;
  }
  for (const WindowRecord& kept : record.windows) {
    auto window = std::make_shared<WindowModel>();
    *window = {kept.id, kept.version, kept.begin_m, kept.end_m, nullptr, {}, kept.evidence, nullptr};
    window->set_model(explicit_ ? explicit_model(geometry_, *explicit_, account)
                                : build_strip(geometry_, *snapshot->map, kept.begin_m, kept.end_m, strip_));
    snapshot->windows.push_back(std::move(window));
  }
  snapshot_ = snapshot;
}

std::shared_ptr<const SceneSnapshot> Scene::snapshot() const {
  const std::lock_guard lock(swap_);
  return snapshot_;
}

void Scene::swap_in(std::shared_ptr<SceneSnapshot> next) {
  std::shared_ptr<const SceneSnapshot> old = std::move(next);  // destroyed outside the lock
  const std::lock_guard lock(swap_);
  snapshot_.swap(old);
}

std::size_t Scene::line_near(double y_m) const {
  if (!(y_m >= 0 && y_m <= geometry_.depth_m))
    throw std::invalid_argument(fmt::format(
        "open.line_y_m: {} is outside the tissue; give a depth within [0, {}] m", y_m, geometry_.depth_m));
  std::size_t nearest = 0;
  for (std::size_t j = 1; j < lines_m_.size(); ++j)
    if (std::abs(lines_m_[j] - y_m) < std::abs(lines_m_[nearest] - y_m)) nearest = j;
  const bool held = (nearest == 0 && geometry_.supports.top == EdgeSupport::kFixed) ||
                    (nearest + 1 == lines_m_.size() && geometry_.supports.bottom == EdgeSupport::kFixed);
  if (held)
    throw std::invalid_argument(fmt::format(
        "open.line_y_m: the line at {} m is held by a support and cannot be touched; give another depth",
        lines_m_[nearest]));
  return nearest;
}

void Scene::check_window(double begin_m, double end_m) const {
  if (explicit_)
    throw Error(
        ErrorKind::kPrecondition,
        fmt::format("publish.scene_id: scene {} was made from an explicit modulus and takes no windows; "
                    "create one without",
                    id_));
  if (geometry_.supports != Supports{})
    throw Error(
        ErrorKind::kPrecondition,
        fmt::format("publish.scene_id: an estimate assumes tissue that is held at its bottom and free "
                    "elsewhere, and the edges of scene {} are held otherwise; publish into a scene that "
                    "is, or make this one from an explicit modulus",
                    id_));
  if (!std::isfinite(begin_m) || !std::isfinite(end_m) || begin_m < -kOverhangM || end_m <= begin_m ||
      end_m > geometry_.width_m + kOverhangM)
    throw std::invalid_argument(
        fmt::format("publish.window_x_m: the window [{}, {}) m is not within the tissue, [0, {}] m; "
                    "move the window or make the scene wider",
                    begin_m, end_m, geometry_.width_m));
}

std::shared_ptr<const TissueModel> Scene::build(const StitchedMap& map, double begin_m, double end_m,
                                                const TissueModel* before) const {
  std::set<std::size_t> lines;
  {
    const std::lock_guard lock(users_);
    lines.insert(lines_in_use_.begin(), lines_in_use_.end());
  }
  StripOptions strip = strip_;
  strip.interior_lines = !lines.empty() && *lines.rbegin() > 0;
  auto model = build_strip(geometry_, map, begin_m, end_m, strip, before);
  for (const std::size_t line : lines) try {
      model->condensed(line, before);
    } catch (const MemoryRefused& refused) {  // who touches it finds it unprepared; others have their window
      spdlog::warn("event=line_not_prepared line={} error=\"{}\"", line, refused.what());
    }
  return model;
}

namespace {

std::shared_ptr<const WindowEvidence> evidence_of(const WindowEstimate& estimate, const StitchedMap& map,
                                                  const SceneGeometry& geometry) {
  auto evidence = std::make_shared<WindowEvidence>(estimate.evidence);
  const double half_m = map.cell_x_m() / 2;  // cells whose centres the window covers
  const StitchedMap::Measured measured = map.measured(
      estimate.window_x_m + half_m, estimate.window_x_m + estimate.width_m - half_m, 0, geometry.depth_m);
  evidence->measured_share = measured.share;
  evidence->log_deviation = measured.log_deviation;
  return evidence;
}

// Whether the ranges together cover `wanted`, but for kSameWindowM at its ends.
bool covers(std::vector<Covered> ranges, const Covered& wanted) {
  std::sort(ranges.begin(), ranges.end(), [](const auto& a, const auto& b) { return a.begin_m < b.begin_m; });
  double reached_m = wanted.begin_m;
  for (const Covered& range : ranges)
    if (range.begin_m <= reached_m + Scene::kSameWindowM) reached_m = std::max(reached_m, range.end_m);
  return reached_m >= wanted.end_m - Scene::kSameWindowM;
}

}  // namespace

Published Scene::publish(const WindowEstimate& estimate, const std::function<bool()>& cancelled) {
  const double end_of_estimate_m = estimate.window_x_m + estimate.width_m;
  check_window(estimate.window_x_m, end_of_estimate_m);
  const auto check = [&] {
    if (deleted()) throw Error(ErrorKind::kAborted, fmt::format("scene {} was deleted", id_));
    if (cancelled && cancelled()) throw Error(ErrorKind::kCancelled, "the caller cancelled");
  };
  const std::lock_guard lock(publishing_);
  const auto old = snapshot();
  auto map = std::make_shared<StitchedMap>(*old->map);
  map->paste(estimate);
  auto window = std::make_shared<WindowModel>();
  window->begin_m = std::max(0.0, estimate.window_x_m);
  window->end_m = std::min(geometry_.width_m, end_of_estimate_m);
  window->taken_in = estimate.evidence.taken_in;
  window->evidence = evidence_of(estimate, *map, geometry_);
  auto next = std::make_shared<SceneSnapshot>();
  next->windows = make_room(*old, *window);
  check();
  const auto same = std::find_if(old->windows.begin(), old->windows.end(),
                                 [&](const auto& other) { return other->id == window->id; });
  window->set_model(build(*map, window->begin_m, window->end_m,
                          same == old->windows.end() ? nullptr : (*same)->model.get()));
  check();
  window->version = versions_->next();
  next_window_id_ = std::max(next_window_id_, window->id + 1);
  next->version = window->version;
  next->map = map;
  next->windows.push_back(window);
  std::sort(next->windows.begin(), next->windows.end(),
            [](const auto& a, const auto& b) { return a->begin_m < b->begin_m; });
  mark_stale_around(*window, *next);
  Published published{window->id, window->version, {}};
  if (next->lone(*window)) published.warnings.emplace_back(kLoneWarning);
  swap_in(next);
  return published;
}

std::vector<std::shared_ptr<const WindowModel>> Scene::make_room(const SceneSnapshot& old,
                                                                 WindowModel& window) const {
  std::vector<std::shared_ptr<const WindowModel>> others;
  for (const auto& other : old.windows) {
    if (std::abs(other->begin_m - window.begin_m) < kSameWindowM)
      window.id = other->id;
    else
      others.push_back(other);
  }
  // Oldest first, so that the newest stay where several passes of a probe overlap.
  auto by_age = others;
  std::sort(by_age.begin(), by_age.end(),
            [](const auto& a, const auto& b) { return a->version < b->version; });
  for (const auto& candidate : by_age) {
    std::vector<Covered> rest{{window.begin_m, window.end_m}};
    for (const auto& other : others)
      if (other != candidate) rest.push_back({other->begin_m, other->end_m});
    if (covers(std::move(rest), {candidate->begin_m, candidate->end_m})) std::erase(others, candidate);
  }
  if (others.size() >= limits_.most_windows)
    throw Error(ErrorKind::kExhausted,
                fmt::format("publish: scene {} has {} windows already; delete the scene or "
                            "publish at the windows' places",
                            id_, limits_.most_windows));
  if (window.id == 0) window.id = next_window_id_;
  return others;
}

void Scene::mark_stale_around(const WindowModel& published, const SceneSnapshot& snapshot) {
  constexpr double kRoundingM = 1e-6;
  const double near_m = strip_.refresh_m - kRoundingM;
  stale_.erase(published.id);
  for (const auto& other : snapshot.windows)
    if (other->id != published.id && other->begin_m - near_m < published.end_m &&
        other->end_m + near_m > published.begin_m)
      stale_.insert(other->id);
}

bool Scene::refresh_stale_window() {
  const std::lock_guard lock(publishing_);
  const auto old = snapshot();
  const double finger_x_m = finger_.now().position_m[0];
  std::shared_ptr<const WindowModel> nearest;
  double nearest_m = HUGE_VAL;
  for (const auto& window : old->windows) {
    const double away_m = std::abs(0.5 * (window->begin_m + window->end_m) - finger_x_m);
    if (stale_.contains(window->id) && away_m < nearest_m) nearest = window, nearest_m = away_m;
  }
  if (!nearest || deleted()) {
    stale_.clear();
    return false;
  }
  auto fresh = std::make_shared<WindowModel>(*nearest);
  fresh->set_model(build(*old->map, nearest->begin_m, nearest->end_m, nearest->model.get()));
  fresh->version = versions_->next();
  stale_.erase(nearest->id);  // not before: what fails stays stale
  auto next = std::make_shared<SceneSnapshot>(*old);
  next->version = fresh->version;
  std::replace(next->windows.begin(), next->windows.end(), nearest,
               std::shared_ptr<const WindowModel>(fresh));
  swap_in(next);
  return !stale_.empty();
}

void Scene::use_line(std::size_t line) {
  const std::lock_guard lock(users_);
  lines_in_use_.insert(line);
}

void Scene::leave_line(std::size_t line) {
  const std::lock_guard lock(users_);
  if (const auto found = lines_in_use_.find(line); found != lines_in_use_.end()) lines_in_use_.erase(found);
}

SceneRecord Scene::record() const {
  const auto now = snapshot();
  SceneRecord record;
  record.id = id_;
  record.geometry = geometry_;
  record.version = now->version;
  record.explicit_modulus = explicit_;
  if (now->map) {
    record.map_modulus_pa = now->map->youngs_modulus_pa();
    record.map_states = now->map->states();
    record.map_log_deviation = now->map->log_deviation();
  }
  for (const auto& w : now->windows) {
    record.windows.push_back({w->id, w->version, w->begin_m, w->end_m, w->evidence});
    record.next_window_id = std::max(record.next_window_id, w->id + 1);
  }
  return record;
}

}  // namespace teletact::service
