// Scenes on disk, so that they survive the service: DIR/scenes/<id>/scene.json and one raw file of its map.
// Everything is written beside its place, synced and renamed, and the folders that name it are synced: once a
// call has returned, what it did outlives a power failure; one in between leaves the old or the new state. An
// entry that cannot be read is logged and moved to DIR/set-aside; it never stops the service. All of it is
// the owner's alone, what an earlier version has left, too.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "service/base/memory.h"
#include "service/scene/files.h"
#include "service/scene/scene_record.h"

namespace teletact::service {

class StateStore;

// Hands out versions: none twice, whatever happens to the service. Shared by all scenes, so that a scene made
// again under an old name does not repeat versions either. Thread-safe.
class VersionCounter {
 public:
  // Where there is a store, versions come from blocks that it has reserved on disk beforehand. `used_up` is
  // called when there are none left: have reserve_ahead() called, on another thread.
  explicit VersionCounter(StateStore* store, std::function<void()> used_up = {});
  // Never waits for the disk. Throws Error(kExhausted) when the block is used up, which takes a disk that
  // took no reservation for half a block, or when this service took over.
  std::uint64_t next();
  // `version` has been handed out, whatever the store says. Writes to disk if it must.
  void used(std::uint64_t version);
  // Reserves the next block on disk when less than half of this one is left. For the thread that writes
  // state.
  void reserve_ahead();

 private:
  void reserve(std::uint64_t limit);
  StateStore* const store_;
  const std::function<void()> used_up_;
  std::mutex writing_;  // one reservation at a time; never held with a next() waiting
  std::mutex mutex_;
  std::uint64_t next_, reserved_;
};

class StateStore {
 public:
  // Versions are handed out from blocks of this size that are reserved on disk first: none is used twice,
  // even when the service dies before it has written a scene. So large that a disk which is full for months
  // does not stop publications.
  static constexpr std::uint64_t kVersionBlock = 1'000'000'000;

  // Makes and locks `directory`. Throws std::runtime_error with one line when it cannot be written or another
  // process holds it; with `wait` it returns once that one lets it go, and where the disk is full by then no
  // versions are reserved.
  explicit StateStore(const std::filesystem::path& directory, const Limits& = {},
                      std::shared_ptr<Files> = machine_files(), bool wait = false);

  // Reads one scene after another: `take` has it before the next is read, and must not throw. What is read is
  // charged to `account` meanwhile. What cannot be read now, though nothing may be wrong with it, stays where
  // it is: `left` is told.
  using Take = std::function<void(const SceneRecord&)>;
  using Left = std::function<void(const std::string& id, const char* why)>;
  void load(const Take& take, const Left& left = {}, const MemoryAccount& account = {});
  // The next three throw FileError.
  void save(const SceneRecord&);
  void remove(const std::string& id);
  // Returns once versions below `limit` may be handed out.
  void reserve_versions(std::uint64_t limit);
  // For another process; nothing may be written from then on.
  void let_go() { lock_.reset(); }
  // Versions that were never handed out: the first one, and the end of those reserved.
  std::uint64_t first_version() const { return first_version_; }
  std::uint64_t reserved_versions() const { return reserved_; }

 private:
  using Path = std::filesystem::path;
  void make_folders();
  void keep_private();
  void sweep();
  void load(const std::string& id, const Take&, const MemoryAccount&);
  void set_aside(const std::string& id, const std::string& why);
  void place_file(const Path&, const std::string& bytes);
  const std::shared_ptr<Files> files_;
  const Path directory_, scenes_;
  const Limits limits_;  // a scene beyond them is set aside
  std::shared_ptr<void> lock_;
  std::uint64_t first_version_ = 1, reserved_ = 1;
};

}  // namespace teletact::service
