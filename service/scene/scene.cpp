#include "service/scene/scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>

#include "service/device/cancellation.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

std::shared_ptr<const ExplicitModulus> charged(ExplicitModulus e, const MemoryAccount& account) {
  struct Charged {
    Charge charge;
    ExplicitModulus modulus;
  };
  const std::size_t values = e.x_m.size() + e.y_m.size() + e.z_m.size() + e.slices_m.size() +
                             e.youngs_modulus_pa.size() + e.log_deviation.size() +
                             e.hidden_log_variance.size();
  std::size_t bytes = values * sizeof(double);
  for (const std::vector<float>& modes : e.log_modes) bytes += modes.size() * sizeof(float);
  auto held =
      std::make_shared<const Charged>(Charged{account.charge(Place::kHost, "maps", bytes), std::move(e)});
  return {held, &held->modulus};
}

// Null of none.
std::shared_ptr<const BMode> charged(BMode image, const MemoryAccount& account) {
  struct Charged {
    Charge charge;
    BMode image;
  };
  if (image.grey.empty()) return nullptr;
  auto held = std::make_shared<const Charged>(
      Charged{account.charge(Place::kHost, "maps", image.grey.size()), std::move(image)});
  return {held, &held->image};
}

BMode in_scene(BMode image, double window_x_m) {
  image.grid.origin_x_m += window_x_m;
  return image;
}

}  // namespace

Scene::Scene(std::string id, const SceneGeometry& geometry, std::shared_ptr<VersionCounter> versions,
             const Limits& limits, const MemoryAccount& account, std::shared_ptr<const TouchModels> models)
    : id_(std::move(id)),
      geometry_(geometry),
      account_(account),
      models_(std::move(models)),
      versions_(std::move(versions)),
      limits_(limits),
      layers_(models_->layers(geometry_)) {
  auto empty = std::make_shared<SceneSnapshot>();
  empty->map = std::make_shared<const StitchedMap>(geometry_, account);
  snapshot_ = empty;
}

Scene::Scene(std::string id, const SceneGeometry& geometry, ExplicitModulus modulus,
             std::shared_ptr<VersionCounter> versions, const Limits& limits, const MemoryAccount& account,
             std::shared_ptr<const TouchModels> models)
    : id_(std::move(id)),
      geometry_(geometry),
      account_(account),
      models_(std::move(models)),
      versions_(std::move(versions)),
      limits_(limits),
      next_window_id_(2) {
  auto snapshot = std::make_shared<SceneSnapshot>();
  snapshot->modulus = charged(std::move(modulus), account_);
  auto window = std::make_shared<WindowModel>();
  window->id = 1;
  window->taken_in = std::chrono::steady_clock::now();
  window->model = models_->of_modulus(geometry_, *snapshot->modulus, account_);
  window->region = window->model->region();
  layers_ = window->model->layers();
  window->version = versions_->next();
  snapshot->version = window->version;
  snapshot->windows.push_back(std::move(window));
  snapshot_ = snapshot;
}

Scene::Scene(const SceneRecord& record, std::shared_ptr<VersionCounter> versions, const Limits& limits,
             const MemoryAccount& account, std::shared_ptr<const TouchModels> models)
    : id_(record.id),
      geometry_(record.geometry),
      account_(account),
      models_(std::move(models)),
      versions_(std::move(versions)),
      limits_(limits),
      next_window_id_(record.next_window_id) {
  auto snapshot = std::make_shared<SceneSnapshot>();
  snapshot->version = record.version;
  if (record.explicit_modulus) {
    snapshot->modulus = charged(*record.explicit_modulus, account_);
    for (const auto& [z_m, tissues] : record.told.slices) told_.tell(z_m, tissues, record.told.words);
  } else {
    auto map = std::make_shared<StitchedMap>(geometry_, account);
    map->restore(record.map_modulus_pa, record.map_states, record.map_log_deviation);
    snapshot->map = map;
    layers_ = models_->layers(geometry_);
  }
  for (const WindowRecord& kept : record.windows) {
    auto window = std::make_shared<WindowModel>();
    *window = {kept.id, kept.version, {kept.begin_m, kept.end_m}, nullptr, {}, kept.evidence};
    if (kept.b_mode) window->b_mode = charged(*kept.b_mode, account_);
    const auto& given = snapshot->modulus;
    window->model = given ? models_->of_modulus(geometry_, *given, account_)
                          : build(*snapshot->map, window->region, nullptr);
    if (given) layers_ = window->model->layers(), window->region = window->model->region();
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

Layer Scene::layer_near(double depth_m) const {
  if (!(depth_m >= 0 && depth_m <= geometry_.depth_m) || layers_.empty())
    throw std::invalid_argument(
        fmt::format("open.layer.depth_m: {} is outside the tissue; give a depth within [0, {}] m", depth_m,
                    geometry_.depth_m));
  const auto away_m = [depth_m](const Layer& layer) { return std::abs(layer.depth_m - depth_m); };
  const Layer nearest = *std::min_element(
      layers_.begin(), layers_.end(), [&](const Layer& a, const Layer& b) { return away_m(a) < away_m(b); });
  const bool at_top = geometry_.supports.top == EdgeSupport::kFixed && depth_m <= away_m(nearest);
  const bool at_bottom =
      geometry_.supports.bottom == EdgeSupport::kFixed && geometry_.depth_m - depth_m < away_m(nearest);
  if (at_top || at_bottom)
    throw std::invalid_argument(
        fmt::format("open.layer.depth_m: the layer at {} m is held by a support and cannot be touched; give "
                    "another depth",
                    at_top ? 0 : geometry_.depth_m));
  constexpr double kRoundingM = 1e-6;
  double spacing_m = 0;
  for (std::size_t j = 1; j < layers_.size(); ++j)
    if (layers_[j - 1] == nearest || layers_[j] == nearest)
      spacing_m = std::max(spacing_m, layers_[j].depth_m - layers_[j - 1].depth_m);
  if (away_m(nearest) > spacing_m / 2 + kRoundingM)
    throw std::invalid_argument(
        fmt::format("open.layer.depth_m: no layer lies near {} m; the nearest one is {} m deep, give that",
                    depth_m, nearest.depth_m));
  return nearest;
}

void Scene::check_window(double begin_m, double end_m) const {
  if (snapshot()->modulus)
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
        fmt::format("publish.window.origin_m: the window [{}, {}) m is not within the tissue, [0, {}] m; "
                    "move the window or make the scene wider",
                    begin_m, end_m, geometry_.width_m));
}

std::shared_ptr<const TouchModel> Scene::build(const StitchedMap& map, const Region& region,
                                               const TouchModel* before) const {
  WantedModel wanted{geometry_, map, region, {}, before, account_};
  {
    const std::lock_guard lock(users_);
    std::unique_copy(layers_in_use_.begin(), layers_in_use_.end(), std::back_inserter(wanted.in_use));
  }
  return models_->of_window(wanted);
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
bool covers(std::vector<Region> ranges, const Region& wanted) {
  std::sort(ranges.begin(), ranges.end(),
            [](const auto& a, const auto& b) { return a.begin_x_m < b.begin_x_m; });
  double reached_m = wanted.begin_x_m;
  for (const Region& range : ranges)
    if (range.begin_x_m <= reached_m + Scene::kSameWindowM) reached_m = std::max(reached_m, range.end_x_m);
  return reached_m >= wanted.end_x_m - Scene::kSameWindowM;
}

}  // namespace

Published Scene::publish(const WindowEstimate& estimate) {
  const double end_of_estimate_m = estimate.window_x_m + estimate.width_m;
  check_window(estimate.window_x_m, end_of_estimate_m);
  const auto check = [&] {
    require_exists();
    check_cancelled();
  };
  const std::lock_guard lock(publishing_);
  const auto old = snapshot();
  auto map = std::make_shared<StitchedMap>(*old->map);
  map->paste(estimate);
  auto window = std::make_shared<WindowModel>();
  window->region = {std::max(0.0, estimate.window_x_m), std::min(geometry_.width_m, end_of_estimate_m)};
  window->taken_in = estimate.evidence.taken_in;
  window->evidence = evidence_of(estimate, *map, geometry_);
  window->b_mode = charged(in_scene(estimate.b_mode, estimate.window_x_m), account_);
  auto next = std::make_shared<SceneSnapshot>();
  next->windows = make_room(*old, *window);
  check();
  const auto same = std::find_if(old->windows.begin(), old->windows.end(),
                                 [&](const auto& other) { return other->id == window->id; });
  window->model = build(*map, window->region, same == old->windows.end() ? nullptr : (*same)->model.get());
  check();
  window->version = versions_->next();
  next_window_id_ = std::max(next_window_id_, window->id + 1);
  next->version = window->version;
  next->map = map;
  next->windows.push_back(window);
  std::sort(next->windows.begin(), next->windows.end(),
            [](const auto& a, const auto& b) { return a->region.begin_x_m < b->region.begin_x_m; });
  mark_stale_around(*window, *next);
  Published published{window->id, window->version, {}};
  if (next->lone(*window)) published.warnings.push_back(lone_warning());
  swap_in(next);
  return published;
}

std::shared_ptr<const ExplicitModulus> Scene::solid() const {
  auto modulus = snapshot()->modulus;
  if (!modulus || !modulus->solid())
    throw Error(
        ErrorKind::kPrecondition,
        fmt::format("scene_id: scene {} is not a solid and takes no slices; create one with modulus.z_m",
                    id_));
  return modulus;
}

Published Scene::publish(const ModulusSlice& slice) {
  const std::lock_guard lock(publishing_);
  require_exists();
  const auto old = snapshot();
  GrownModulus grown = with_slice(*solid(), slice, limits_);
  auto window = std::make_shared<WindowModel>(*old->windows.front());
  window->taken_in = std::chrono::steady_clock::now();
  window->model = models_->of_slice(geometry_, grown.modulus, grown.slice, *window->model, account_);
  const std::uint64_t id = window->id;
  swap_in(std::move(window), charged(std::move(grown.modulus), account_));
  return {id, snapshot()->version, {}};
}

std::shared_ptr<const TouchModel> Scene::renewed() const {
  const auto now = snapshot();
  return now->modulus ? now->windows.front()->model->renewed(account_) : nullptr;
}

void Scene::renew(const TouchModel& renewed) {
  const std::lock_guard lock(publishing_);
  if (deleted()) return;
  const auto old = snapshot();
  auto window = std::make_shared<WindowModel>(*old->windows.front());
  window->model = models_->of_slice(geometry_, *old->modulus, std::nullopt, renewed, account_);
  swap_in(std::move(window), old->modulus);
}

// Called with publishing_ held.
void Scene::swap_in(std::shared_ptr<WindowModel> window, std::shared_ptr<const ExplicitModulus> modulus) {
  auto next = std::make_shared<SceneSnapshot>();
  next->version = window->version = versions_->next();
  next->modulus = std::move(modulus);
  next->windows.push_back(std::move(window));
  swap_in(std::move(next));
}

std::vector<std::shared_ptr<const WindowModel>> Scene::make_room(const SceneSnapshot& old,
                                                                 WindowModel& window) const {
  std::vector<std::shared_ptr<const WindowModel>> others;
  for (const auto& other : old.windows) {
    if (std::abs(other->region.begin_x_m - window.region.begin_x_m) < kSameWindowM)
      window.id = other->id;
    else
      others.push_back(other);
  }
  // Oldest first, so that the newest stay where several passes of a probe overlap.
  auto by_age = others;
  std::sort(by_age.begin(), by_age.end(),
            [](const auto& a, const auto& b) { return a->version < b->version; });
  for (const auto& candidate : by_age) {
    std::vector<Region> rest{window.region};
    for (const auto& other : others)
      if (other != candidate) rest.push_back(other->region);
    if (covers(std::move(rest), candidate->region)) std::erase(others, candidate);
  }
  if (others.size() >= limits_.max_windows)
    throw Error(ErrorKind::kExhausted,
                fmt::format("publish: scene {} has {} windows already; delete the scene or "
                            "publish at the windows' places",
                            id_, limits_.max_windows));
  if (window.id == 0) window.id = next_window_id_;
  return others;
}

void Scene::mark_stale_around(const WindowModel& published, const SceneSnapshot& snapshot) {
  constexpr double kRoundingM = 1e-6;
  const double near_m = models_->context_m() - kRoundingM;
  stale_.erase(published.id);
  for (const auto& other : snapshot.windows)
    if (other->id != published.id && other->region.begin_x_m - near_m < published.region.end_x_m &&
        other->region.end_x_m + near_m > published.region.begin_x_m)
      stale_.insert(other->id);
}

bool Scene::refresh_stale_window() {
  const std::lock_guard lock(publishing_);
  const auto old = snapshot();
  const double finger_x_m = finger_.now().position_m[0];
  std::shared_ptr<const WindowModel> nearest;
  double nearest_m = HUGE_VAL;
  for (const auto& window : old->windows) {
    const double away_m = std::abs(0.5 * (window->region.begin_x_m + window->region.end_x_m) - finger_x_m);
    if (stale_.contains(window->id) && away_m < nearest_m) nearest = window, nearest_m = away_m;
  }
  if (!nearest || deleted()) {
    stale_.clear();
    return false;
  }
  auto fresh = std::make_shared<WindowModel>(*nearest);
  fresh->model = build(*old->map, nearest->region, nearest->model.get());
  fresh->version = versions_->next();
  stale_.erase(nearest->id);  // not before: what fails stays stale
  auto next = std::make_shared<SceneSnapshot>(*old);
  next->version = fresh->version;
  std::replace(next->windows.begin(), next->windows.end(), nearest,
               std::shared_ptr<const WindowModel>(fresh));
  swap_in(next);
  return !stale_.empty();
}

void Scene::require_exists() const {
  if (deleted()) throw Error(ErrorKind::kAborted, fmt::format("scene {} was deleted", id_));
}

void Scene::use_layer(const Layer& layer) {
  const std::lock_guard lock(users_);
  layers_in_use_.insert(layer);
}

void Scene::leave_layer(const Layer& layer) {
  const std::lock_guard lock(users_);
  if (const auto found = layers_in_use_.find(layer); found != layers_in_use_.end())
    layers_in_use_.erase(found);
}

SceneRecord Scene::record() const {
  const auto now = snapshot();
  SceneRecord record;
  record.id = id_;
  record.geometry = geometry_;
  record.version = now->version;
  if (now->modulus) record.explicit_modulus = *now->modulus, record.told = told_.all();
  if (now->map) {
    record.map_modulus_pa = now->map->youngs_modulus_pa();
    record.map_states = now->map->states();
    record.map_log_deviation = now->map->log_deviation();
  }
  for (const auto& w : now->windows) {
    record.windows.push_back(
        {w->id, w->version, w->region.begin_x_m, w->region.end_x_m, w->evidence, w->b_mode});
    record.next_window_id = std::max(record.next_window_id, w->id + 1);
  }
  return record;
}

}  // namespace teletact::service
