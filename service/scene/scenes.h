// All scenes of the service: made, found, kept on disk, deleted. Thread-safe.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "service/scene/niced_worker.h"
#include "service/scene/scene.h"

namespace teletact::service {

class Scenes {
 public:
  // `state_directory` empty: nothing is kept. Throws std::runtime_error with one line when it cannot be used.
  explicit Scenes(const std::filesystem::path& state_directory, const Limits& = {});
  ~Scenes();  // writes what was published

  // Builds the models of the scenes kept on disk; one that cannot be built is logged and set aside.
  void restore();

  // `id` empty: chosen here. Throws std::invalid_argument (field named), Error(kAlreadyExists | kExhausted).
  std::shared_ptr<Scene> create(const std::string& id, const SceneGeometry&, std::optional<ExplicitModulus>);
  std::shared_ptr<Scene> find(const std::string& id) const;  // Error(kNotFound)
  std::vector<std::shared_ptr<Scene>> list() const;
  void remove(const std::string& id);  // Error(kNotFound)

  // On the imaging worker: publishes, then refreshes the neighbours and keeps the scene in the background.
  Published publish(const std::shared_ptr<Scene>&, const WindowEstimate&,
                    const std::function<bool()>& cancelled);
  // The imaging worker.
  NicedWorker& worker() { return worker_; }

 private:
  void keep(const std::shared_ptr<Scene>&);
  void keep_later(const std::shared_ptr<Scene>&);
  void refresh_later(const std::shared_ptr<Scene>&);
  void add(const std::shared_ptr<Scene>&);
  const Limits limits_;
  std::unique_ptr<StateStore> store_;
  std::shared_ptr<VersionCounter> versions_;
  mutable std::mutex mutex_;
  std::map<std::string, std::shared_ptr<Scene>> scenes_;
  std::set<std::string> being_made_;             // ids taken while their models are built
  std::set<const Scene*> refreshing_, keeping_;  // a background job waits for them
  std::mutex disk_;
  // Last: their jobs use all of the above.
  // Scenes may outlive this: what they ask for then is dropped.
  const std::shared_ptr<NicedWorker> preparer_ = std::make_shared<NicedWorker>(),
                                     measurer_ = std::make_shared<NicedWorker>();
  NicedWorker keeper_;  // writes state, so that a slow disk does not hold up imaging
  NicedWorker worker_;
};

}  // namespace teletact::service
