// A frame source whose pairs are all made before anything moves, in parallel over its windows.
#pragma once

#include <functional>
#include <vector>

#include "client/acquire/frame_source.h"

namespace teletact::client {

class PreparedSource : public FrameSource {
 public:
  // It counts windows, and is called from worker threads, one at a time.
  using Progress = std::function<void(std::size_t done, std::size_t total)>;

  std::size_t window_count() const override { return windows_.size(); }
  std::size_t frames_left(std::size_t window) const override;
  FramePair take(std::size_t window) override;

 protected:
  // A window's passes, on `threads` threads (0: one per processor). Throws std::invalid_argument for no
  // windows or no passes, and what `passes_of` throws.
  void prepare(std::size_t windows, std::size_t passes, const Progress& progress,
               const std::function<std::vector<FramePair>(std::size_t window)>& passes_of,
               unsigned threads = 0);

 private:
  struct Window {
    std::vector<FramePair> passes;
    std::size_t taken = 0;
  };
  std::vector<Window> windows_;
};

}  // namespace teletact::client
