// Keeps scenes on disk, on a thread of its own: nobody who makes or publishes a scene waits for the disk. A
// disk that takes nothing stops the keeping alone; that is said once, and again when it takes something.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <exception>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <string>

#include "service/scene/scene.h"
#include "service/scene/state_store.h"
#include "service/scene/workers.h"

namespace teletact::service {

// Thread-safe.
class StateKeeper {
 public:
  // `directory` empty: nothing is kept. Throws std::runtime_error with one line when it cannot be used. With
  // `standby` it is load() that makes and locks it, and waits while another process holds it.
  StateKeeper(const std::filesystem::path& directory, const Limits&, std::shared_ptr<Files>, bool standby);
  ~StateKeeper();  // as finish()

  // From load() on.
  const std::shared_ptr<VersionCounter>& versions() const { return versions_; }
  // What was kept, for the start, as StateStore reads it.
  void load(const StateStore::Take&, const StateStore::Left&, const MemoryAccount&);

  // Writes a new scene. `done` is called on the keeper's thread, or at once where nothing is kept: with
  // nothing when the scene outlives a power failure, with Error(kExhausted | kUnavailable) when it cannot be
  // kept.
  void keep_new(const std::shared_ptr<Scene>&, std::function<void(std::exception_ptr)> done);
  // Writes it soon, as it is then.
  void keep_later(const std::shared_ptr<Scene>&);
  // Finds a scene by `find` and takes it away from disk, then calls `gone`; no scene is written meanwhile.
  // Throws what `find` throws, and Error(kUnavailable) when the disk does not take it: nothing is changed
  // then.
  void remove(const std::function<std::shared_ptr<Scene>()>& find,
              const std::function<void(const std::shared_ptr<Scene>&)>& gone);

  // Why nothing is kept at present, for people; empty: it is.
  std::string trouble() const;
  // Returns once all that was to be written has been, or could not be.
  void wait_until_idle();
  // The same; what comes later is not written.
  void finish();
  // The same, then lets the directory go, for another process. Nobody may make or publish scenes any more;
  // remove() is refused with Error(kUnavailable).
  void let_go();

 private:
  void open(bool wait);
  void write(const std::shared_ptr<Scene>&);
  void reserve_later();
  void write_or_say(const std::shared_ptr<Scene>&);
  void note(const std::shared_ptr<Scene>&, const std::string& why);  // empty: written
  const std::filesystem::path directory_;
  const Limits limits_;
  const std::shared_ptr<Files> files_;
  std::unique_ptr<StateStore> store_;
  std::shared_ptr<VersionCounter> versions_;
  std::mutex disk_;
  bool gone_ = false;  // let go; with disk_
  mutable std::mutex mutex_;
  std::set<std::shared_ptr<Scene>> waiting_, unkept_;  // for the keeper; for the disk to take them
  std::string trouble_;
  Workers keeper_;  // last: its jobs use all of the above
};

}  // namespace teletact::service
