// The uniform cells on which a scene is shown, by their centres, in scene coordinates.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "service/imaging/tracking/frame.h"
#include "service/scene/scene.h"

namespace teletact::service {

// Index i + nx j of the grid's nodes, the cells' centres.
struct CellView {
  static constexpr std::size_t kCellBytes = 2 * sizeof(float) + 1;
  ImageGrid grid;
  std::vector<float> modulus_pa;     // 0 where nothing was published
  std::vector<float> log_deviation;  // standard deviation of ln E; NaN where not known
  std::vector<std::uint8_t> valid;   // 1 where measured
};

// All of a scene's cells.
ImageGrid cells_of(const SceneSnapshot&, const SceneGeometry&);
// Those of columns [begin, end). Where the modulus was given, each shows the element that its centre lies in;
// of a solid, in the slice nearest to the middle.
CellView view_of(const SceneSnapshot&, const SceneGeometry&, std::size_t begin = 0,
                 std::size_t end = std::numeric_limits<std::size_t>::max());

}  // namespace teletact::service
