// The B-mode image of a frame, as it is kept and sent.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "service/imaging/tracking/frame.h"

namespace teletact::service {

// B-mode image (T2.9). Grey value g of node (i, j) at i + nx j: 60 (g / 255 - 1) dB of the image's largest
// envelope, 0 at -60 dB and below. Nodes along x are the A-lines; a row stands for the mean power of so many
// samples that there are at most 512 rows.
struct BMode {
  static constexpr double kRangeDb = 60;
  static constexpr std::size_t kMaxRows = 512;
  ImageGrid grid;
  std::vector<std::uint8_t> grey;
};

}  // namespace teletact::service
