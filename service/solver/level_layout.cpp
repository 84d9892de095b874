#include "service/solver/level_layout.h"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>

namespace teletact::service {

namespace {

// Least and most distance between neighbouring lines.
std::pair<double, double> spacings(const std::vector<double>& lines) {
  std::pair<double, double> found{lines[1] - lines[0], lines[1] - lines[0]};
  for (std::size_t i = 1; i + 1 < lines.size(); ++i) {
    found.first = std::min(found.first, lines[i + 1] - lines[i]);
    found.second = std::max(found.second, lines[i + 1] - lines[i]);
  }
  return found;
}

}  // namespace

LineTransfer coarsen(const std::vector<double>& fine, double widest) {
  LineTransfer t;
  const std::size_t count = fine.size();
  for (std::size_t i = 0; i < count;) {
    t.at.push_back(static_cast<int>(i));
    i += i + 2 < count && fine[i + 2] - fine[i] <= widest ? 2 : 1;
  }
  for (const int i : t.at) t.coarse.push_back(fine[static_cast<std::size_t>(i)]);
  t.around.assign(2 * t.at.size(), 0.0);
  for (std::size_t i = 0, c = 0; i < count; ++i) {
    if (c + 1 < t.at.size() && static_cast<int>(i) == t.at[c + 1]) ++c;
    const bool coincides = static_cast<int>(i) == t.at[c];
    const double weight = coincides ? 0 : (fine[i] - t.coarse[c]) / (t.coarse[c + 1] - t.coarse[c]);
    t.left.push_back(static_cast<int>(c));
    t.weight.push_back(weight);
    if (coincides) continue;
    t.around[2 * c + 1] = 1 - weight;
    t.around[2 * (c + 1)] = weight;
  }
  return t;
}

GridTransfer coarsen(const NodeLines& fine, double& spacing) {
  const double extent = std::max(fine.x.back() - fine.x.front(), fine.y.back() - fine.y.front());
  for (;; spacing *= 2) {
    GridTransfer t{coarsen(fine.x, kWidestInterval * spacing), coarsen(fine.y, kWidestInterval * spacing)};
    const bool coarser = t.x.at.size() < fine.x.size() || t.y.at.size() < fine.y.size();
    if (coarser || spacing > extent) return t;
  }
}

GridTransfer coarsen_fully(const NodeLines& fine) {
  constexpr double kAny = std::numeric_limits<double>::infinity();
  return {coarsen(fine.x, kAny), coarsen(fine.y, kAny)};
}

ShortSide short_side(const NodeLines& lines) {
  const auto [min_x, max_x] = spacings(lines.x);
  const auto [min_y, max_y] = spacings(lines.y);
  const bool tall = max_y > kStretched * min_x, wide = max_x > kStretched * min_y;
  return tall == wide ? ShortSide::kNeither : tall ? ShortSide::kX : ShortSide::kY;
}

double smallest_spacing(const NodeLines& lines) {
  return std::min(spacings(lines.x).first, spacings(lines.y).first);
}

namespace {

void smooth(int level, std::size_t steps, bool from_zero, std::vector<PlannedStep>& plan) {
  for (std::size_t k = 0; k < steps; ++k) {
    const bool first = from_zero && k == 0;  // the residual is the right-hand side
    if (!first) plan.push_back({CycleStep::kResidual, level});
    plan.push_back({first ? CycleStep::kSmoothFromZero : CycleStep::kSmooth, level, static_cast<int>(k)});
  }
}

void cycle(int level, int last, std::size_t steps, std::vector<PlannedStep>& plan) {
  if (level == last) {
    plan.push_back({CycleStep::kSolve, level});
    return;
  }
  smooth(level, steps, true, plan);
  const bool twice = level > 0 && level + 1 < last;  // not where the next level is solved exactly
  for (int visit = 0; visit < (twice ? 2 : 1); ++visit) {
    plan.push_back({CycleStep::kResidual, level});
    plan.push_back({CycleStep::kRestrict, level});
    cycle(level + 1, last, steps, plan);
    plan.push_back({CycleStep::kProlong, level});
    smooth(level, steps, false, plan);
  }
}

}  // namespace

std::vector<PlannedStep> plan_cycle(std::size_t levels, std::size_t smoothing_steps) {
  std::vector<PlannedStep> plan{{CycleStep::kPack}};
  cycle(0, static_cast<int>(levels) - 1, smoothing_steps, plan);
  plan.push_back({CycleStep::kUnpack});
  return plan;
}

std::vector<ChebyshevStep> chebyshev_steps(double lowest, double highest, unsigned steps) {
  const double theta = (highest + lowest) / 2, delta = (highest - lowest) / 2, sigma = theta / delta;
  std::vector<ChebyshevStep> out{{0, 1 / theta}};
  double rho = 1 / sigma;
  while (out.size() < steps) {
    const double next = 1 / (2 * sigma - rho);
    out.push_back({next * rho, 2 * next / delta});
    rho = next;
  }
  return out;
}

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
