// The part of a contact law (common/contact_law.h) that is near the finger, as the link hands it to the
// servo: of a fixed size, copied as a whole.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "common/contact_law.h"

namespace teletact::client {

struct NearLaw {
  // Columns: 60 mm of a window whose law is fine, or 40 mm of 8 lanes of a solid.
  static constexpr std::size_t kMax = 64, kMaxLanes = 8;
  std::array<LawColumn, kMax> columns{};
  std::size_t count = 0;
  double layer_depth_m = 0;  // of the layer that it is of, whose normal is y
  std::span<const LawColumn> used() const noexcept { return {columns.data(), count}; }
};

}  // namespace teletact::client
