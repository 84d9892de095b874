// Slices that were estimated before a neighbour of theirs was there: their frames, so that they can be
// estimated again with what that tells of the tissue across their image. Not thread-safe.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "client/acquire/frame_source.h"

namespace teletact::client {

class SliceCorrections {
 public:
  explicit SliceCorrections(std::size_t slices) : slices_(slices) {}
  // How many of the two beside it are published.
  std::size_t neighbours(std::size_t slice) const;
  // It was estimated when `neighbours` of them were. The frames are kept while one may come.
  void published(std::size_t slice, FramePair pair, std::size_t neighbours);
  // One that a neighbour came to since.
  std::optional<std::size_t> due() const;
  FramePair take(std::size_t slice);

 private:
  struct Slice {
    bool published = false;
    std::size_t knew = 0;  // neighbours
    std::optional<FramePair> pair = {};
  };
  std::vector<Slice> slices_;
};

}  // namespace teletact::client
