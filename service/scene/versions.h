// Hands out versions: none twice, whatever happens to the service. Shared by all scenes, so that a scene made
// again under an old name does not repeat versions either.
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>

namespace teletact::service {

class StateStore;

// Thread-safe.
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

}  // namespace teletact::service
