#include "service/tissue/block_tridiagonal.h"

#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "service/solver/level_layout.h"
#include "service/tissue/condensation.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// As in kernels/block_tridiagonal.cl.
constexpr std::size_t kRows = 8, kMostUnknowns = 128, kPlanes = 5, kEntries = 18;
// Nodes of the short side up to which it is faster even where multigrid need not smooth by lines: 32 columns
// of 121 x 25 took 21 ms of processor time for 99, and those of 61 x 61 a third of multigrid's, but one
// column there with what is made beforehand 19 ms for 8.
constexpr std::size_t kMostOfSquares = 32;
// Items on a GPU, as many as it has: what each adds up is the longest chain. Two for each row of a block at
// least.
constexpr std::size_t kLeastGroup = 256, kMostGroup = 1024;
constexpr std::size_t kExpected = 8;  // iterations in float: a few
// It must stop by itself: a launch is not cancelled. Where so many do not do, rounding has lost the
// preconditioner.
constexpr std::size_t kMostIterations = 64;
// The preconditioned operator's eigenvalues are one but for rounding, of which one iteration shows little:
// the smallest is taken for no more than this.
constexpr double kSmallestEigenvalue = 0.5;

// A block of the operator: entries of the rows of line s towards line s + ds, six for each (LayerCoupling).
LayerCoupling band(const std::vector<double>& rows, std::size_t unknowns, std::size_t size, std::size_t s,
                   int ds) {
  LayerCoupling block;
  block.band.resize(Index(size), 6);
  for (std::size_t k = 0; k < size; ++k)
    for (std::size_t e = 0; e < 6; ++e)
      block.band(Index(k), Index(e)) = rows[(6 * std::size_t(ds + 1) + e) * unknowns + s * size + k];
  return block;
}

MatrixXd dense(const LayerCoupling& block) {
  const Index size = block.band.rows();
  MatrixXd full = MatrixXd::Zero(size, size);
  for (Index k = 0; k < size; ++k)
    for (Index e = 0; e < 6; ++e)
      if (const Index to = k - k % 2 - 2 + e; to >= 0 && to < size) full(k, to) = block.band(k, e);
  return full;
}

}  // namespace

bool is_narrow(const DeviceInfo& info, const TissueGrid& grid) {
  const std::size_t nodes = std::min(grid.nx(), grid.ny());
  const bool stretched = short_side({grid.x_m, grid.y_m}) != ShortSide::kNeither;
  return nodes <= (stretched ? kMostUnknowns / 2 : kMostOfSquares) &&
         (!info.gpu || info.max_group >= kLeastGroup);
}

template <class T>
BlockTridiagonalPcg<T>::BlockTridiagonalPcg(const Queue& queue, const ScaledTissue& tissue,
                                            const PcgOptions& options)
    : queue_(queue),
      options_(options),
      width_(queue.info().width<T>()),
      group_(queue.info().gpu ? std::min(kMostGroup, std::bit_floor(queue.info().max_group)) : 1),
      unknowns_(tissue.grid.dofs()) {
  options_.max_iterations = kOneStep ? 1 : std::min(options_.max_iterations, kMostIterations);
  const TissueGrid& grid = tissue.grid;
  const bool columns = grid.ny() <= grid.nx();  // are the blocks
  const std::size_t steps = columns ? grid.nx() : grid.ny(), nodes = columns ? grid.ny() : grid.nx();
  const std::size_t along = columns ? 1 : grid.nx(), across = columns ? grid.nx() : 1;
  const std::size_t size = 2 * nodes, padded = (size + kRows - 1) / kRows * kRows, unknowns = grid.dofs();
  shape_ = {static_cast<int>(steps), static_cast<int>(size),   static_cast<int>(padded),
            static_cast<int>(along), static_cast<int>(across), 0};
  const std::vector<double> stencil = stencil_on_host(tissue);
  std::vector<double> rows(kEntries * unknowns);
  for (std::size_t u = 0; u < unknowns; ++u)
    for (std::size_t e = 0; e < kEntries; ++e) {
      const std::size_t node = u / size * along + u % size / 2 * across, ds = e / 6, dj = e % 6 / 2;
      const std::size_t k = columns ? 3 * dj + ds : 3 * ds + dj;
      rows[e * unknowns + u] = stencil[4 * (k * grid.nodes() + node) + 2 * (u % 2) + e % 2];
    }
  std::vector<T> inverses(steps * padded * size);
  LayerWorkspace workspace{Index(size)};
  MatrixXd change(size, size);  // of the next block
  try {
    for (std::size_t s = 0; s < steps; ++s) {
      MatrixXd block = dense(band(rows, unknowns, size, s, 0));
      if (s > 0) block.triangularView<Eigen::Lower>() += change;
      const std::size_t next = s + 1 < steps ? s + 1 : 0;  // that couples to none before it
      eliminate(block, band(rows, unknowns, size, next, -1), workspace, change);
      for (std::size_t row = 0; row < size; ++row)
        for (std::size_t column = 0; column < size; ++column)
          inverses[(s * padded + row / kRows * kRows) * size + column * kRows + row % kRows] =
              static_cast<T>(block(Index(column), Index(row)));
    }
  } catch (const std::domain_error&) {
    throw std::invalid_argument("tissue: the stiffness is not symmetric positive definite");
  }
  // The operator from differences.
  for (std::size_t u = 0; u < unknowns; ++u)
    for (std::size_t e = 0; e < kEntries; ++e)
      if (e / 2 != 4) rows[(8 + e % 2) * unknowns + u] += rows[e * unknowns + u];
  rows_ = queue_.array(std::vector<T>(rows.begin(), rows.end()));
  inverses_ = queue_.array(inverses);
  const Defines defines{{"WIDTH", std::to_string(width_)}, {"GROUP", std::to_string(group_)}};
  const auto get = [&](const char* name) {
    return queue.kernel("block_tridiagonal", name, precision_of<T>, defines);
  };
  solve_ = get("solve_whole");
  apply_ = get("apply_whole");
}

template <class T>
void BlockTridiagonalPcg<T>::reserve(std::size_t count) {
  const std::size_t groups = (count + width_ - 1) / width_;
  auto scalars = queue_.array<T>((kPcgFields + kPcgHistory * options_.max_iterations) * count);
  work_ = queue_.array<T>(groups * width_ * kPlanes * unknowns_);
  scalars_ = std::move(scalars);
  capacity_ = count;
}

template <class T>
typename BlockTridiagonalPcg<T>::Shape BlockTridiagonalPcg<T>::shape_of(std::size_t count) const {
  if (count > capacity_)
    throw std::invalid_argument("BlockTridiagonalPcg: more right-hand sides than it was made for");
  Shape shape = shape_;
  shape.rhs = static_cast<int>(count);
  return shape;
}

// Sweeps there and back over all blocks, each behind the one before: of a row an item of a GPU adds up its
// part, some of them the parts, and what the neighbouring block gives; a processor's all rows, kRows at once.
template <class T>
Range BlockTridiagonalPcg<T>::range(std::size_t count, std::size_t sweeps) const {
  constexpr std::size_t kCoupled = 6, kAtOnce = 4;
  const auto steps = static_cast<std::size_t>(shape_.steps), size = static_cast<std::size_t>(shape_.size),
             padded = static_cast<std::size_t>(shape_.padded), parts = group_ / padded;
  const std::size_t each =
      parts > 0 ? (size + parts - 1) / parts + (parts - 1) / kAtOnce + kAtOnce - 1 : padded / kRows * size;
  return {{(count + width_ - 1) / width_ * group_}, {group_}, 2 * sweeps * steps * (each + kCoupled)};
}

template <class T>
std::vector<PcgResult> BlockTridiagonalPcg<T>::solve(std::size_t count, Array<T>& r, const Array<T>& load,
                                                     Array<T>& x, const std::vector<double>& initial_energy,
                                                     const std::vector<double>& absolute_error) {
  std::vector<T> scalars = pcg_scalars<T>(count, initial_energy, absolute_error);
  queue_.send(scalars_, scalars.data(), scalars.size());
  solve_(range(count, kOneStep ? 1 : 2), rows_, inverses_, r, load, x, work_, scalars_, shape_of(count),
         static_cast<int>(options_.max_iterations),
         static_cast<T>(options_.relative_error * options_.relative_error));
  const auto read = [&](std::size_t iterations) {
    scalars.resize((kPcgFields + kPcgHistory * iterations) * count);
    queue_.read(scalars_, scalars.data(), scalars.size());
  };
  read(std::min(kExpected, options_.max_iterations));
  const auto took = scalars.begin() + static_cast<std::ptrdiff_t>(kPcgIterations * count);
  const T most = *std::max_element(took, took + static_cast<std::ptrdiff_t>(count));
  if (most > static_cast<T>(kExpected)) read(static_cast<std::size_t>(most));
  std::vector<PcgResult> results = pcg_results(scalars, count);
  for (PcgResult& result : results) {
    result.smallest_eigenvalue = std::min(result.smallest_eigenvalue, kSmallestEigenvalue);
    if (!kOneStep || result.iterations == 0) continue;
    result.squared_error = std::numeric_limits<double>::infinity();
    if (result.reason == StopReason::kIterationLimit) result.reason = StopReason::kConverged;
  }
  return results;
}

template <class T>
std::vector<double> BlockTridiagonalPcg<T>::apply(std::size_t count, const Array<T>& r, Array<T>& z) {
  apply_(range(count, 1), rows_, inverses_, r, z, work_, scalars_, shape_of(count));
  std::vector<T> products(count);
  queue_.read(scalars_, products.data(), products.size());
  return {products.begin(), products.end()};
}

template class BlockTridiagonalPcg<float>;
template class BlockTridiagonalPcg<double>;

}  // namespace teletact::service
