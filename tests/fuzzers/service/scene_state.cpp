// The service's state on disk: versions.json, a scene's scene.json and its map, one after the other, with a 0
// between.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "service/rpc/palpation_messages.h"
#include "service/scene/scene.h"
#include "service/scene/state_store.h"
#include "tests/fuzzers/service/fuzzers.h"
#include "tests/scene/losing_disk.h"

namespace teletact::fuzzers {
namespace {

using namespace service;

// So small that what is kept is restored in milliseconds.
Limits small_limits() {
  Limits limits;
  limits.max_scene_columns = 17;
  limits.max_scene_elements = limits.max_solid_elements = 256;
  limits.max_scene_width_m = limits.max_scene_depth_m = 0.02;
  return limits;
}

// A file says CHECKSUM where the map's belongs, or no map would come through that a fuzzer changed.
std::string with_checksum(std::string description, const std::string& map) {
  const std::string mark = "CHECKSUM";
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const char c : map) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3ULL;
  if (const auto at = description.find(mark); at != std::string::npos)
    description.replace(at, mark.size(), fmt::format("{:016x}", hash));
  return description;
}

std::shared_ptr<LosingDisk> disk_of(Bytes bytes) {
  auto disk = std::make_shared<LosingDisk>();
  const auto write = [&](const char* path, const std::string& text) {
    disk->write(path, std::span(text.data(), text.size()));
  };
  for (const char* folder : {"/state", "/state/scenes", "/state/scenes/s"}) disk->make_folder(folder);
  write("/state/versions.json", text_of(cut(bytes)));
  const std::string description = text_of(cut(bytes)), map = text_of(bytes);
  write("/state/scenes/s/scene.json", with_checksum(description, map));
  write("/state/scenes/s/map-1.raw", map);
  return disk;
}

void check(const Scene& scene, const Limits& limits) {
  v1::Scene message;
  scene_to(scene, v1::SCENE_VIEW_FULL, 1, &message);
  require(message.youngs_modulus().values().data().size() > 0, "a scene that cannot be told");
  const auto snapshot = scene.snapshot();
  for (const auto& window : snapshot->windows)
    require(window->version <= scene.snapshot()->version, "a window newer than its scene");
  if (const auto& e = scene.snapshot()->modulus) {
    for (const auto* nodes_m : {&e->x_m, &e->y_m, &e->z_m, &e->slices_m})
      for (std::size_t n = 1; n < nodes_m->size(); ++n)
        require((*nodes_m)[n - 1] < (*nodes_m)[n], "nodes or slices out of order");
    for (const double modulus_pa : e->youngs_modulus_pa) require(modulus_pa >= 1, "a modulus that cannot be");
  }
  const EncodedScene written = encoded(scene.record());
  const SceneRecord again = decoded(
      written.description, [&](const std::string&) { return written.map; }, limits);
  require(encoded(again).description == written.description && encoded(again).map == written.map,
          "it is kept as another");
}

}  // namespace

bool scene_state(Bytes bytes) {
  require_plain_log();
  static const Limits limits = small_limits();
  const auto disk = disk_of(bytes);
  StateStore store("/state", limits, disk);
  std::unique_ptr<Scene> scene;
  bool left = false;
  store.load([&](const SceneRecord& record) {
    left = !accepted<std::exception>([&] { scene = std::make_unique<Scene>(record, nullptr, limits); });
  });
  require(store.first_version() > 0 && store.first_version() < store.reserved_versions(),
          "versions that were handed out already");
  if (scene) {
    check(*scene, limits);
    return true;
  }
  require(disk->exists("/state/scenes/s") == left, "a scene is not where it was left");
  require(left || disk->list("/state/set-aside").size() == 1, "a scene is neither there nor set aside");
  return false;
}

}  // namespace teletact::fuzzers
