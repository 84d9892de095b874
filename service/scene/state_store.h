// Scenes on disk, so that they survive the service: DIR/scenes/<id>/scene.json and one raw file of its map.
// Everything is written beside its place, synced and renamed, so that a crash leaves the old or the new
// state. An entry that cannot be read is logged and moved to DIR/set-aside; it never stops the service.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "service/scene/geometry.h"
#include "service/scene/stitched_map.h"

namespace teletact::service {

struct WindowRecord {
  std::uint64_t id = 0, version = 0;
  double begin_m = 0, end_m = 0;
  std::shared_ptr<const WindowEvidence> evidence =
      nullptr;  // null: none was kept, or the modulus is explicit
};

// An explicit modulus with its own grid: nodes x_m, y_m and E per element, x fastest.
struct ExplicitModulus {
  std::vector<double> x_m, y_m, youngs_modulus_pa;
};

struct SceneRecord {
  std::string id;
  SceneGeometry geometry;
  std::uint64_t version = 0, next_window_id = 1;
  std::vector<WindowRecord> windows;
  // One of the two, or neither while nothing is published.
  std::optional<ExplicitModulus> explicit_modulus;
  std::vector<float> map_modulus_pa;
  std::vector<CellState> map_states;
  std::vector<float> map_log_deviation;
};

class StateStore {
 public:
  // Versions are handed out from blocks of this size that are reserved on disk first: none is used twice,
  // even when the service dies before it has written a scene.
  static constexpr std::uint64_t kVersionBlock = 1000;

  // Makes and locks `directory`. Throws std::runtime_error with one line when it cannot be written or another
  // process holds it.
  explicit StateStore(std::filesystem::path directory, const Limits& = {});
  ~StateStore();
  StateStore(const StateStore&) = delete;
  StateStore& operator=(const StateStore&) = delete;

  std::vector<SceneRecord> load();
  void save(const SceneRecord&);
  void remove(const std::string& id);
  // Moves a scene that cannot be used to DIR/set-aside and logs why.
  void set_aside(const std::string& id, const std::string& why);
  // First version that was never handed out.
  std::uint64_t first_version() const { return first_version_; }
  // Returns once versions below `limit` may be handed out.
  void reserve_versions(std::uint64_t limit);

 private:
  SceneRecord load_scene(const std::filesystem::path& folder) const;
  std::filesystem::path directory_;
  const Limits limits_;  // a scene beyond them is set aside
  std::uint64_t first_version_ = 1;
  int lock_file_ = -1;
};

}  // namespace teletact::service
