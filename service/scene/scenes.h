// All scenes of the service: made, found, kept on disk, deleted. Thread-safe.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "service/scene/scene.h"
#include "service/scene/state_keeper.h"
#include "service/scene/workers.h"

namespace teletact::service {

class Scenes {
 public:
  // `state_directory` empty: nothing is kept. Throws std::runtime_error with one line when it cannot be used.
  // `memory` (may be null): what its scenes are charged to; `models`: what they are touched on.
  explicit Scenes(const std::filesystem::path& state_directory, const Limits& = {},
                  std::shared_ptr<Files> = machine_files(), std::shared_ptr<MemoryBudget> memory = {},
                  std::shared_ptr<const TouchModels> models = tissue_models(), bool standby = false);
  ~Scenes();  // writes what was published

  // Builds the models of the scenes kept on disk; one that cannot be built is logged and left
  // there. With `standby` it is here that the directory is taken, as soon as no other process holds it.
  void restore();
  // Writes what was published, then gives the directory up. Scenes are touched on; nobody may make or publish
  // any more, and remove() throws Error(kUnavailable).
  void let_go() { state_.let_go(); }

  // With the scene, or with why it cannot be kept: Error(kExhausted | kUnavailable). Must not throw.
  using Made = std::function<void(const std::shared_ptr<Scene>&, std::exception_ptr)>;
  // On the imaging plane: builds a scene, and does not wait for the disk. `made` is called, on another thread
  // where there is a disk, when the scene is there for all and outlives a power failure, or when it cannot be
  // kept. `id` empty: chosen here. Throws std::invalid_argument (field named), Error(kAlreadyExists |
  // kExhausted). `client`: who pays for the scene's memory; MemoryRefused when there is none left.
  void make(const std::string& id, const SceneGeometry&, std::optional<ExplicitModulus>, const Made& made,
            const std::string& client = {});
  std::shared_ptr<Scene> find(const std::string& id) const;  // Error(kNotFound)
  std::vector<std::shared_ptr<Scene>> list() const;
  // Error(kNotFound), and kUnavailable where the disk keeps it: nothing is changed then.
  void remove(const std::string& id);

  // Writes it to disk soon, as it is then.
  void keep_later(const std::shared_ptr<Scene>& scene) { state_.keep_later(scene); }
  // Whether the disk takes nothing at present.
  bool trouble_with_disk() const { return !state_.trouble().empty(); }
  // Returns once what was to be kept so far has been written, or could not be.
  void wait_until_kept() { state_.wait_until_idle(); }

 private:
  void restore(const SceneRecord&);
  void leave_on_disk(const std::string& id, const char* why);
  std::string reserve(const std::string& wanted_id);
  void add(const std::shared_ptr<Scene>&);
  const Limits limits_;
  const std::shared_ptr<MemoryBudget> memory_;
  const std::shared_ptr<const TouchModels> models_;
  mutable std::mutex mutex_;
  std::map<std::string, std::shared_ptr<Scene>> scenes_;
  std::set<std::string> being_made_;    // ids taken while their models are built and first kept
  std::set<std::string> left_on_disk_;  // ids of scenes that could not be restored
  // Last: their jobs use all of the above.
  StateKeeper state_;
  // Scenes may outlive this: what they ask for then is dropped.
  const std::shared_ptr<Workers> preparer_ = std::make_shared<Workers>();
};

}  // namespace teletact::service
