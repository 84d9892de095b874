#include "service/solver/multigrid.h"

#include <algorithm>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "service/solver/chebyshev.h"
#include "service/solver/convert.h"
#include "service/solver/dense_inverse.h"
#include "service/solver/smoother.h"

namespace teletact::service {
namespace {

template <class T>
std::vector<T> as(const std::vector<double>& values) {
  return {values.begin(), values.end()};
}

// Interpolation arrays of one direction on the device.
template <class T>
struct LineArrays {
  Array<int> at, left;
  Array<T> around, weight;
  LineArrays(const Queue& queue, const LineTransfer& t)
      : at(queue.array(t.at)),
        left(queue.array(t.left)),
        around(queue.array(as<T>(t.around))),
        weight(queue.array(as<T>(t.weight))) {}
};

template <class T>
Array<T> mask_array(const Queue& queue, const std::vector<std::uint8_t>& free) {
  return queue.array(std::vector<T>(free.begin(), free.end()));
}

// A coarse unknown is constrained where the fine one at its place is.
std::vector<std::uint8_t> coarse_mask(const std::vector<std::uint8_t>& fine, const LineTransfer& x,
                                      const LineTransfer& y) {
  std::vector<std::uint8_t> coarse;
  for (const int j : y.at)
    for (const int i : x.at) {
      const std::size_t node = static_cast<std::size_t>(i) + x.left.size() * static_cast<std::size_t>(j);
      coarse.push_back(fine[2 * node]);
      coarse.push_back(fine[2 * node + 1]);
    }
  return coarse;
}

}  // namespace

template <class T>
struct Multigrid<T>::Level {
  NodeLines lines;
  int nx = 0, ny = 0;
  GridTransfer to_coarse;
  std::unique_ptr<LineArrays<T>> x, y;
  Array<T> free;
  std::shared_ptr<Array<T>> stencil;
  Array<T> inverse_diagonal;
  std::unique_ptr<Smoother<T>> smoother;
  Array<T> direction, residual;  // d of the smoother; r - A z
  Array<T> r, z;                 // right-hand side and correction of this level, not on the finest
  std::size_t nodes() const { return lines.nodes(); }
};

template <class T>
struct Multigrid<T>::Kernels {
  explicit Kernels(const Queue& queue) {
    const auto get = [&](const char* name) { return queue.kernel("multigrid", name, precision_of<T>); };
    residual = get("stencil_residual");
    interior = get("relax_interior");
    restriction = get("restrict_residual");
    prolong = get("prolong_add");
    dense = get("dense_apply");
  }
  Kernel residual, interior, restriction, prolong, dense;
};

template <class T>
Multigrid<T>::Multigrid(const Queue& queue, const NodeLines& lines, const MultigridOptions& options)
    : queue_(queue), short_side_(short_side(lines)), kernels_(std::make_unique<Kernels>(queue)) {
  const double largest = short_side_ == ShortSide::kNeither ? kLargestCellEigenvalue : kLargestLineEigenvalue;
  steps_ = chebyshev_steps(largest / options.smoothing_range, largest, std::max(1U, options.smoothing_steps));
  NodeLines current = lines;
  for (double spacing = smallest_spacing(lines);; spacing *= 2) {
    auto level = std::make_unique<Level>();
    level->lines = current;
    level->nx = static_cast<int>(current.x.size());
    level->ny = static_cast<int>(current.y.size());
    level->to_coarse =
        short_side_ == ShortSide::kNeither ? coarsen(current, spacing) : coarsen_fully(current);
    NodeLines coarse{level->to_coarse.x.coarse, level->to_coarse.y.coarse};
    const bool last = current.nodes() <= options.coarsest_nodes || coarse.nodes() == current.nodes();
    if (!last) {
      level->x = std::make_unique<LineArrays<T>>(queue, level->to_coarse.x);
      level->y = std::make_unique<LineArrays<T>>(queue, level->to_coarse.y);
    }
    levels_.push_back(std::move(level));
    if (last) break;
    current = std::move(coarse);
  }
}

template <class T>
Multigrid<T>::~Multigrid() = default;

template <class T>
std::size_t Multigrid<T>::levels() const {
  return levels_.size();
}

template <class T>
std::shared_ptr<const Array<T>> Multigrid<T>::stencil() const {
  return levels_.front()->stencil;
}

template <class T>
template <class S>
void Multigrid<T>::set_operator(const Array<S>& stencil, const std::vector<std::uint8_t>& free) {
  Array<int> indefinite = queue_.array(std::vector<int>{0});
  set_level(0, stencil, free, indefinite);
  if (queue_.read(indefinite)[0])
    throw std::invalid_argument("multigrid: the operator is not symmetric positive definite");
}

template <class T>
template <class S>
void Multigrid<T>::set_level(std::size_t index, const Array<S>& stencil,
                             const std::vector<std::uint8_t>& free, Array<int>& indefinite) {
  Level& level = *levels_[index];
  const std::size_t nodes = level.nodes();
  if (index + 1 == levels_.size()) {
    const std::vector<S> host = queue_.read(stencil);
    return invert_coarsest({host.begin(), host.end()});
  }
  auto inverse = queue_.array<S>(4 * nodes);
  queue_.kernel("galerkin", "invert_diagonal", precision_of<S>)({{nodes}, {64}}, stencil, inverse,
                                                                static_cast<int>(nodes));
  level.free = mask_array<T>(queue_, free);
  level.stencil = std::make_shared<Array<T>>(converted<T>(queue_, stencil));
  level.inverse_diagonal = converted<T>(queue_, inverse);
  const std::size_t nx = level.lines.x.size(), ny = level.lines.y.size();
  level.smoother =
      short_side_ == ShortSide::kNeither
          ? make_cell_smoother<T>(queue_, stencil, nx, ny, indefinite)
          : make_line_smoother<T>(queue_, stencil, nx, ny, short_side_ == ShortSide::kX, indefinite);
  const auto coarse_free = coarse_mask(free, level.to_coarse.x, level.to_coarse.y);
  levels_[index + 1]->free = mask_array<T>(queue_, coarse_free);
  set_level(index + 1, coarse_operator(index, stencil, free, coarse_free), coarse_free, indefinite);
}

// P^T A P
template <class T>
template <class S>
Array<S> Multigrid<T>::coarse_operator(std::size_t index, const Array<S>& stencil,
                                       const std::vector<std::uint8_t>& free,
                                       const std::vector<std::uint8_t>& coarse_free) const {
  const Level &level = *levels_[index], &next = *levels_[index + 1];
  const std::size_t nx = next.lines.x.size(), ny = next.lines.y.size();
  const LineArrays<S> x(queue_, level.to_coarse.x), y(queue_, level.to_coarse.y);
  const Array<S> fine_mask = mask_array<S>(queue_, free);
  auto rows = queue_.array<S>(16 * (nx - 1) * (ny - 1)), coarse = queue_.array<S>(36 * nx * ny);
  queue_.kernel("galerkin", "interior_rows", precision_of<S>)(grid_range(nx - 1, ny - 1, 1), stencil, rows,
                                                              x.at, y.at, x.weight, y.weight, fine_mask,
                                                              level.nx, level.ny, next.nx, next.ny);
  queue_.kernel("galerkin", "galerkin_product", precision_of<S>)(
      grid_range(nx, ny, 9), stencil, rows, coarse, x.at, y.at, x.left, x.weight, y.left, y.weight, fine_mask,
      mask_array<S>(queue_, coarse_free), level.nx, level.ny, next.nx, next.ny);
  return coarse;
}

template <class T>
void Multigrid<T>::invert_coarsest(const std::vector<double>& stencil) {
  const Level& level = *levels_.back();
  const std::size_t nx = level.lines.x.size(), ny = level.lines.y.size(), nodes = nx * ny, n = 2 * nodes;
  std::vector<double> dense(n * n);
  for (std::size_t node = 0; node < nodes; ++node)
    for (std::size_t k = 0; k < 9; ++k) {
      const std::size_t i = node % nx + k % 3, j = node / nx + k / 3;  // of the neighbour, plus one
      if (i < 1 || i > nx || j < 1 || j > ny) continue;
      const std::size_t to = (i - 1) + nx * (j - 1);
      for (std::size_t c = 0; c < 4; ++c)
        dense[(2 * node + c / 2) * n + 2 * to + c % 2] = stencil[4 * (k * nodes + node) + c];
    }
  invert_symmetric(dense, n);
  inverse_ = queue_.array(as<T>(dense));
}

template <class T>
void Multigrid<T>::reserve(std::size_t count) {
  if (count <= reserved_) return;
  reserved_ = count;
  for (std::size_t index = 0; index < levels_.size(); ++index) {
    Level& level = *levels_[index];
    const std::size_t size = 2 * level.nodes() * count;
    for (Array<T>* a : {&level.direction, &level.residual}) *a = queue_.array<T>(size);
    if (index == 0) continue;
    level.r = queue_.array<T>(size);
    level.z = queue_.array<T>(size);
  }
}

template <class T>
void Multigrid<T>::apply(const Array<T>& r, Array<T>& z, std::size_t count) {
  reserve(count);
  cycle(0, r, z, count);
}

// Polynomial smoothing of z.
template <class T>
void Multigrid<T>::smooth(Level& level, const Array<T>& r, Array<T>& z, std::size_t count, bool from_zero) {
  const Range range = grid_range(level.lines.x.size(), level.lines.y.size(), count);
  for (std::size_t k = 0; k < steps_.size(); ++k) {
    const bool first = from_zero && k == 0;  // the residual is r
    if (!first) kernels_->residual(range, *level.stencil, r, z, level.residual, level.nx, level.ny);
    level.smoother->step(first ? r : level.residual, level.direction, z, steps_[k], first, count);
  }
}

// Equilibrium of the nodes inside coarse cells: before and after bilinear transfers it makes them those of P.
template <class T>
void Multigrid<T>::relax_interior(const Level& level, const Level& next, const Array<T>& r, Array<T>& z,
                                  std::size_t count) {
  kernels_->interior(grid_range(next.lines.x.size() - 1, next.lines.y.size() - 1, count), *level.stencil,
                     level.inverse_diagonal, r, z, level.x->at, level.y->at, level.nx, level.ny, next.nx,
                     next.ny);
}

template <class T>
void Multigrid<T>::cycle(std::size_t index, const Array<T>& r, Array<T>& z, std::size_t count) {
  Level& level = *levels_[index];
  if (index + 1 == levels_.size()) {
    const std::size_t unknowns = 2 * level.nodes();
    kernels_->dense({{unknowns, count}, {16}}, inverse_, r, z, static_cast<int>(unknowns));
    return;
  }
  Level& next = *levels_[index + 1];
  const Range fine = grid_range(level.lines.x.size(), level.lines.y.size(), count);
  // z = S r
  smooth(level, r, z, count, true);
  // r_c = P^T (r - A z)
  relax_interior(level, next, r, z, count);
  kernels_->residual(fine, *level.stencil, r, z, level.residual, level.nx, level.ny);
  kernels_->restriction(grid_range(next.lines.x.size(), next.lines.y.size(), count), level.residual, next.r,
                        level.x->at, level.x->around, level.y->at, level.y->around, next.free, level.nx,
                        level.ny, next.nx, next.ny);
  cycle(index + 1, next.r, next.z, count);
  // z += P z_c
  kernels_->prolong(fine, next.z, z, level.x->left, level.x->weight, level.y->left, level.y->weight,
                    level.free, level.nx, level.ny, next.nx, next.ny);
  relax_interior(level, next, r, z, count);
  // z += S^T (r - A z)
  smooth(level, r, z, count, false);
}

template class Multigrid<float>;
template class Multigrid<double>;
template void Multigrid<float>::set_operator(const Array<float>&, const std::vector<std::uint8_t>&);
template void Multigrid<float>::set_operator(const Array<double>&, const std::vector<std::uint8_t>&);
template void Multigrid<double>::set_operator(const Array<double>&, const std::vector<std::uint8_t>&);

}  // namespace teletact::service
