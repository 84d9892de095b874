#include "service/scene/scenes.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <future>
#include <random>
#include <stdexcept>

#include "service/scene/errors.h"
#include "service/scene/slices.h"

namespace teletact::service {

namespace {

constexpr std::size_t kLongestId = 64;

void check_id(const std::string& id) {
  const bool plain = std::all_of(id.begin(), id.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  });
  if (!plain || id.size() > kLongestId)
    throw std::invalid_argument(fmt::format(
        "scene_id: must be 1 to {} letters, digits, '_' or '-' (a CreateScene may leave it empty)",
        kLongestId));
}

std::string random_id() {
  std::random_device device;
  return fmt::format("scene-{:08x}", device());
}

}  // namespace

Scenes::Scenes(const std::filesystem::path& state_directory, const Limits& limits,
               std::shared_ptr<Files> files, std::shared_ptr<MemoryBudget> memory,
               std::shared_ptr<const TouchModels> models, bool standby)
    : limits_(limits),
      memory_(std::move(memory)),
      models_(std::move(models)),
      state_(state_directory, limits, std::move(files), standby) {}

Scenes::~Scenes() {
  preparer_->stop();
  state_.finish();
}

void Scenes::restore() {
  state_.load([this](const SceneRecord& record) { restore(record); },
              [this](const std::string& id, const char* why) { leave_on_disk(id, why); },
              MemoryAccount{memory_});
}

void Scenes::restore(const SceneRecord& record) {
  try {
    state_.versions()->used(record.version);
    add(std::make_shared<Scene>(record, state_.versions(), limits_, MemoryAccount{memory_, {}, record.id},
                                models_));
    spdlog::info("event=scene_restored scene={} version={} windows={}", record.id, record.version,
                 record.windows.size());
  } catch (const std::exception& error) {  // no room, or the models refuse it
    leave_on_disk(record.id, error.what());
  }
}

// Nothing is wrong with it: it stays where it is, and nobody writes over it.
void Scenes::leave_on_disk(const std::string& id, const char* why) {
  spdlog::error("event=scene_not_restored scene={} error=\"{}\"", shown(id), shown(why, 500));
  const std::lock_guard lock(mutex_);
  left_on_disk_.insert(id);
}

// Takes the id for a scene that is being made.
std::string Scenes::reserve(const std::string& wanted_id) {
  std::string id = wanted_id;
  const std::lock_guard lock(mutex_);
  while (id.empty()) {
    id = random_id();
    if (scenes_.contains(id) || being_made_.contains(id) || left_on_disk_.contains(id)) id.clear();
  }
  if (left_on_disk_.contains(id))
    throw Error(
        ErrorKind::kAlreadyExists,
        fmt::format(
            "scene_id: {} is kept on disk and could not be restored at the start (scene_not_restored in the "
            "service's log says why); choose another id, or restart the service once that is mended",
            id));
  if (scenes_.contains(id) || being_made_.contains(id))
    throw Error(ErrorKind::kAlreadyExists,
                fmt::format("scene_id: {} is taken; delete that scene or choose another id", id));
  if (scenes_.size() + being_made_.size() >= limits_.max_scenes)
    throw Error(ErrorKind::kExhausted,
                fmt::format("{} scenes exist, the most allowed; delete one", limits_.max_scenes));
  being_made_.insert(id);
  return id;
}

void Scenes::make(const std::string& wanted_id, const SceneGeometry& geometry,
                  std::optional<ExplicitModulus> modulus, const Made& made, const std::string& client) {
  check_id(wanted_id);
  validate(geometry, limits_);
  if (modulus) check_modulus(*modulus, geometry, limits_);
  const std::string id = reserve(wanted_id);
  const auto give_up = [this, id] {
    const std::lock_guard lock(mutex_);
    being_made_.erase(id);
  };
  std::shared_ptr<Scene> scene;
  try {
    const MemoryAccount account{memory_, client, id};
    scene = modulus ? std::make_shared<Scene>(id, geometry, std::move(*modulus), state_.versions(), limits_,
                                              account, models_)
                    : std::make_shared<Scene>(id, geometry, state_.versions(), limits_, account, models_);
  } catch (...) {
    give_up();
    throw;
  }
  state_.keep_new(scene, [this, made, scene, give_up](const std::exception_ptr& error) {
    if (error) {
      give_up();
      return made(nullptr, error);
    }
    add(scene);
    spdlog::info("event=scene_created scene={} version={} width_m={} depth_m={}", scene->id(),
                 scene->snapshot()->version, scene->geometry().width_m, scene->geometry().depth_m);
    made(scene, nullptr);
  });
}

void Scenes::add(const std::shared_ptr<Scene>& scene) {
  scene->set_touch_work([worker = preparer_](const std::string& client, std::function<void()> job) {
    worker->post(std::move(job), client);
  });
  const std::lock_guard lock(mutex_);
  being_made_.erase(scene->id());
  scenes_[scene->id()] = scene;
}

std::shared_ptr<Scene> Scenes::find(const std::string& id) const {
  const std::lock_guard lock(mutex_);
  const auto found = scenes_.find(id);
  if (found == scenes_.end())
    throw Error(
        ErrorKind::kNotFound,
        fmt::format("scene_id: no scene \"{}\" here; ./teletact scenes (ListScenes) lists them", shown(id)));
  return found->second;
}

std::vector<std::shared_ptr<Scene>> Scenes::list() const {
  const std::lock_guard lock(mutex_);
  std::vector<std::shared_ptr<Scene>> all;
  for (const auto& [id, scene] : scenes_) all.push_back(scene);
  return all;
}

void Scenes::remove(const std::string& id) {
  state_.remove([&] { return find(id); },
                [&](const std::shared_ptr<Scene>& scene) {
                  scene->mark_deleted();
                  const std::lock_guard lock(mutex_);
                  scenes_.erase(id);
                });
  spdlog::info("event=scene_deleted scene={}", id);
}

}  // namespace teletact::service
