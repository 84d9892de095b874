#include "client/acquire/slice_corrections.h"

#include <utility>

namespace teletact::client {

std::size_t SliceCorrections::neighbours(std::size_t slice) const {
  return std::size_t{slice > 0 && slices_[slice - 1].published} +
         std::size_t{slice + 1 < slices_.size() && slices_[slice + 1].published};
}

void SliceCorrections::published(std::size_t slice, FramePair pair, std::size_t neighbours) {
  const std::size_t most = std::size_t{slice > 0} + std::size_t{slice + 1 < slices_.size()};
  slices_[slice] = {true, neighbours, {}};
  if (neighbours < most) slices_[slice].pair = std::move(pair);
}

std::optional<std::size_t> SliceCorrections::due() const {
  for (std::size_t slice = 0; slice < slices_.size(); ++slice)
    if (slices_[slice].pair && neighbours(slice) > slices_[slice].knew) return slice;
  return std::nullopt;
}

FramePair SliceCorrections::take(std::size_t slice) {
  FramePair pair = std::move(*slices_[slice].pair);
  slices_[slice].pair.reset();
  return pair;
}

}  // namespace teletact::client
