#include "service/solver/level_layout.h"

#include <limits>
#include <stdexcept>

namespace teletact::service {
namespace {

constexpr std::size_t kStencilPlanes = 20, kInsidePlanes = 16, kVectorPlanes = 8;
constexpr std::size_t kAlignment = 16;  // of planes, in numbers

// Hands out room in an array.
class Room {
 public:
  int take(std::size_t size) {
    const std::size_t at = used_;
    used_ += size;
    if (used_ > static_cast<std::size_t>(std::numeric_limits<int>::max()))
      throw std::invalid_argument("grid: too many nodes for multigrid");
    return static_cast<int>(at);
  }
  void align() { used_ = (used_ + kAlignment - 1) / kAlignment * kAlignment; }
  int used() const { return static_cast<int>(used_); }

 private:
  std::size_t used_ = 0;
};

// An odd multiple of the alignment: planes then do not fall on the same lines of a cache.
std::size_t plane_size(std::size_t nx, std::size_t ny, std::size_t width) {
  const std::size_t least = (nx + 1) * (ny + 2) + 2 + 2 * width;
  return kAlignment * ((least / kAlignment + 1) | 1);
}

// Of the coarse lines, from the first on: those on every second fine line that the next one also keeps to.
int halved(const std::vector<int>& at) {
  std::size_t count = 0;
  while (count + 1 < at.size() && at[count + 1] == static_cast<int>(2 * (count + 1))) ++count;
  return static_cast<int>(count);
}

LevelLayout geometry(const NodeLines& lines, std::size_t width) {
  LevelLayout level;
  level.nx = static_cast<int>(lines.x.size());
  level.ny = static_cast<int>(lines.y.size());
  level.pitch = level.nx + 1;
  level.stride = static_cast<int>(plane_size(lines.x.size(), lines.y.size(), width));
  return level;
}

}  // namespace

HierarchyLayout lay_out(const std::vector<NodeLines>& lines, const std::vector<GridTransfer>& transfers,
                        std::size_t width, std::size_t coefficients) {
  HierarchyLayout layout;
  Room constants, vectors, table;
  for (const NodeLines& of_level : lines) layout.levels.push_back(geometry(of_level, width));
  constexpr std::size_t kFields = sizeof(LevelLayout) / sizeof(int);
  table.take(kFields * lines.size());
  constants.take(coefficients);
  for (std::size_t l = 0; l < transfers.size(); ++l) {
    LevelLayout& level = layout.levels[l];
    level.at_x = table.take(transfers[l].x.at.size());
    level.at_y = table.take(transfers[l].y.at.size());
    level.halved = halved(transfers[l].x.at);
    level.around_x = constants.take(transfers[l].x.around.size());
    level.around_y = constants.take(transfers[l].y.around.size());
  }
  constants.align();
  for (LevelLayout& level : layout.levels)
    level.free = constants.take(2 * static_cast<std::size_t>(level.stride));
  layout.header_size = constants.used();
  for (std::size_t l = 0; l < lines.size(); ++l) {
    LevelLayout& level = layout.levels[l];
    const auto stride = static_cast<std::size_t>(level.stride);
    level.vectors = vectors.take(kVectorPlanes * stride);
    if (l + 1 < lines.size()) {
      level.stencil = constants.take(kStencilPlanes * stride);
      level.smoother = constants.take(kStencilPlanes * stride);
      level.inside = constants.take(kInsidePlanes * static_cast<std::size_t>(layout.levels[l + 1].stride));
    } else {
      const auto span = static_cast<std::size_t>(level.span());
      level.stencil = constants.take(4 * span * ((span + width - 1) / width * width));
    }
  }
  layout.constants_size = constants.used();
  layout.vectors_size = vectors.used();
  layout.table.assign(static_cast<std::size_t>(table.used()), 0);
  for (std::size_t l = 0; l < lines.size(); ++l) {
    const LevelLayout& v = layout.levels[l];
    const int fields[kFields] = {v.nx,       v.ny,   v.pitch,  v.stride,   v.stencil,
                                 v.smoother, v.free, v.inside, v.around_x, v.around_y,
                                 v.at_x,     v.at_y, v.halved, v.vectors};
    std::copy(std::begin(fields), std::end(fields), layout.table.begin() + static_cast<long>(kFields * l));
  }
  for (std::size_t l = 0; l < transfers.size(); ++l) {
    std::copy(transfers[l].x.at.begin(), transfers[l].x.at.end(),
              layout.table.begin() + layout.levels[l].at_x);
    std::copy(transfers[l].y.at.begin(), transfers[l].y.at.end(),
              layout.table.begin() + layout.levels[l].at_y);
  }
  return layout;
}

}  // namespace teletact::service
