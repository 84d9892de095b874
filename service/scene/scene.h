// One piece of tissue in one frame of coordinates: x from its left surface corner, y depth.
//
// What can be touched is an immutable snapshot behind a shared pointer: touch streams take it, imaging swaps
// a newer one in, nobody waits. Publishing a window makes the next version; versions are never reused.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "service/scene/finger.h"
#include "service/scene/geometry.h"
#include "service/scene/observers.h"
#include "service/scene/scene_record.h"
#include "service/scene/slices.h"
#include "service/scene/state_store.h"
#include "service/scene/stitched_map.h"
#include "service/scene/told_slices.h"
#include "service/scene/touch_models.h"

namespace teletact::service {

struct WindowModel {
  std::uint64_t id = 0, version = 0;  // scene version that published it last
  Region region;                      // the finger is here
  std::shared_ptr<const TouchModel> model;
  // When its modulus came in; the epoch where that is not known (read from disk after a restart).
  std::chrono::steady_clock::time_point taken_in{};
  std::shared_ptr<const WindowEvidence> evidence;  // null for an explicit modulus, and where none was kept
  std::shared_ptr<const BMode> b_mode = {};        // the same; in the scene
};

// Whether they touch or overlap.
bool adjoin(const WindowModel&, const WindowModel&);

struct SceneSnapshot {
  std::uint64_t version = 0;                                // 0 = nothing published
  std::vector<std::shared_ptr<const WindowModel>> windows;  // by where they begin
  // What it is made of, one of the two: stitched, or given.
  std::shared_ptr<const StitchedMap> map;
  std::shared_ptr<const ExplicitModulus> modulus;

  // The window for a finger at x: `current` (0 = none) as long as the finger is within `hysteresis_m` of it,
  // else the covering window whose border is farthest. Null where no window covers x.
  std::shared_ptr<const WindowModel> window_at(double x_m, std::uint64_t current, double hysteresis_m) const;
  // Whether no other window adjoins it; false for an explicit modulus.
  bool lone(const WindowModel&) const;
  // The names of what makes it doubtful; they live as long as the window.
  std::vector<std::string_view> flags_of(const WindowModel&) const;
  // The union of adjoining windows around x; empty (begin = end = x) where none covers it.
  Region covered_around(double x_m) const;
};

struct Published {
  std::uint64_t window_id = 0, version = 0;
  std::vector<std::string> warnings;  // what is doubtful beyond the estimate's own: "name: words"
};

class Scene {
 public:
  static constexpr double kSameWindowM = 0.001;  // begins closer than this are the same window
  static constexpr double kOverhangM = 0.001;    // a window may stick out of the tissue by this much

  // `account`: in whose name all that it holds is held; `models`: what its windows are touched on.
  Scene(std::string id, const SceneGeometry&, std::shared_ptr<VersionCounter>, const Limits& = {},
        const MemoryAccount& account = {}, std::shared_ptr<const TouchModels> models = tissue_models());
  // Touchable at once, on exactly this grid. Throws std::invalid_argument (field named).
  Scene(std::string id, const SceneGeometry&, ExplicitModulus, std::shared_ptr<VersionCounter>,
        const Limits& = {}, const MemoryAccount& = {},
        std::shared_ptr<const TouchModels> models = tissue_models());
  // As it was kept; builds its models.
  Scene(const SceneRecord&, std::shared_ptr<VersionCounter>, const Limits& = {}, const MemoryAccount& = {},
        std::shared_ptr<const TouchModels> models = tissue_models());

  const std::string& id() const { return id_; }
  const SceneGeometry& geometry() const { return geometry_; }
  const Limits& limits() const { return limits_; }
  const TouchModels& models() const { return *models_; }
  std::shared_ptr<const SceneSnapshot> snapshot() const;
  FingerBoard& finger() { return finger_; }
  // Work that was begun for them may outlive the scene.
  const std::shared_ptr<Observers>& observers() const { return observers_; }
  // The layer nearest to this depth. Throws std::invalid_argument where a support that holds the tissue is
  // nearer, and further from all layers than half of the distance between two.
  Layer layer_near(double depth_m) const;

  // Throws std::invalid_argument or Error(kPrecondition) when [begin, end) cannot be published.
  void check_window(double begin_m, double end_m) const;
  // Stitches the estimate in, builds its window's model and swaps both in. Windows whose context changed are
  // left for refresh_stale_window(). Nothing changes when it throws.
  Published publish(const WindowEstimate&);
  // What slices are given of. Throws Error(kPrecondition) where the scene is no solid.
  std::shared_ptr<const ExplicitModulus> solid() const;
  // One more slice of a solid, or this one in the place of the one there. Throws std::invalid_argument (field
  // named), Error(kPrecondition) where the scene is no solid, (kExhausted). Nothing changes when it throws.
  Published publish(const ModulusSlice&);
  ToldSlices& told() { return told_; }
  const ToldSlices& told() const { return told_; }
  // Rebuilds the stale window nearest to the finger with its present context, so that the force does not jump
  // when the finger is handed over. False when none is stale.
  bool refresh_stale_window();
  // Of a solid: what is to take the place of a model that slices have worn, which takes long to make; null
  // while it serves. Slices may come meanwhile: renew() has the newest ones solved with what that has.
  std::shared_ptr<const TouchModel> renewed() const;
  void renew(const TouchModel& renewed);

  // Who does what touches ask for and must not wait for. Said once, before the scene is known to others.
  void set_touch_work(TouchWork work) { touch_work_ = std::move(work); }
  const TouchWork& touch_work() const { return touch_work_; }

  // Touch streams name the layers that they use; new models are made ready on them before they are swapped
  // in, so that a touch never waits for that.
  void use_layer(const Layer&);
  void leave_layer(const Layer&);

  SceneRecord record() const;

  // Streams look at it.
  bool deleted() const { return deleted_.load(); }
  void require_exists() const;  // Error(kAborted) once it is deleted
  void mark_deleted() { deleted_ = true; }

 private:
  // `before` (may be null): the model whose place it takes.
  std::shared_ptr<const TouchModel> build(const StitchedMap&, const Region&, const TouchModel* before) const;
  // The windows that stay beside `window`: those that it and the others do not hide. It gets the id of the
  // one whose place it takes, or a new one.
  std::vector<std::shared_ptr<const WindowModel>> make_room(const SceneSnapshot&, WindowModel& window) const;
  void swap_in(std::shared_ptr<SceneSnapshot>);
  // A model for this window alone, from now on.
  void swap_in(std::shared_ptr<WindowModel>, std::shared_ptr<const ExplicitModulus>);
  void mark_stale_around(const WindowModel& published, const SceneSnapshot&);

  const std::string id_;
  const SceneGeometry geometry_;
  const MemoryAccount account_;
  const std::shared_ptr<const TouchModels> models_;
  const std::shared_ptr<VersionCounter> versions_;
  const Limits limits_;
  FingerBoard finger_;
  ToldSlices told_{account_};
  const std::shared_ptr<Observers> observers_ = std::make_shared<Observers>();

  std::mutex publishing_;  // one publication at a time; guards next_window_id_ and stale_
  std::uint64_t next_window_id_ = 1;
  std::set<std::uint64_t> stale_;

  mutable std::mutex swap_;  // held for a pointer's copy only
  std::shared_ptr<const SceneSnapshot> snapshot_;

  std::vector<Layer> layers_;  // the same in every window
  mutable std::mutex users_;
  std::multiset<Layer> layers_in_use_;
  std::atomic<bool> deleted_{false};
  TouchWork touch_work_;
};

}  // namespace teletact::service
