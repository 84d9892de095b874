#include "service/solver/multigrid.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "service/solver/chebyshev.h"
#include "service/solver/dense_inverse.h"

namespace teletact::service {
namespace {

// Power iterations for the largest eigenvalue, and what its estimate is multiplied by to bound it.
constexpr unsigned kPowerIterations = 14;
constexpr double kBoundMargin = 1.1;

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

double dot(const auto& a, const auto& b) {
  double sum = 0;
  for (std::size_t n = 0; n < a.size(); ++n) sum += static_cast<double>(a[n]) * b[n];
  return sum;
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
  std::vector<ChebyshevStep> steps;
  double eigenvalue_bound = 0;
  Array<T> direction, other, residual;  // d and second z of the smoother; r - A z
  Array<T> r, z;                        // right-hand side and correction of this level, not on the finest
  std::size_t nodes() const { return lines.nodes(); }
};

template <class T>
struct Multigrid<T>::Kernels {
  explicit Kernels(const Queue& queue) {
    const auto get = [&](const char* name) { return queue.kernel("multigrid", name, precision_of<T>); };
    apply = get("stencil_apply");
    residual = get("stencil_residual");
    first = get("smooth_first");
    step = get("smooth_step");
    restriction = get("restrict_residual");
    prolong = get("prolong_add");
    dense = get("dense_apply");
  }
  Kernel apply, residual, first, step, restriction, prolong, dense;
};

template <class T>
Multigrid<T>::Multigrid(const Queue& queue, const NodeLines& lines, const MultigridOptions& options)
    : queue_(queue), options_(options), kernels_(std::make_unique<Kernels>(queue)) {
  NodeLines current = lines;
  for (double spacing = smallest_spacing(lines);; spacing *= 2) {
    auto level = std::make_unique<Level>();
    level->lines = current;
    level->nx = static_cast<int>(current.x.size());
    level->ny = static_cast<int>(current.y.size());
    level->to_coarse = coarsen(current, spacing);
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
double Multigrid<T>::eigenvalue_bound(std::size_t level) const {
  return levels_.at(level)->eigenvalue_bound;
}

template <class T>
std::shared_ptr<const Array<T>> Multigrid<T>::stencil() const {
  return levels_.front()->stencil;
}

template <class T>
template <class S>
void Multigrid<T>::set_operator(const Array<S>& stencil, const std::vector<std::uint8_t>& free) {
  set_level(0, stencil, free);
}

// `from` in the working precision.
template <class T>
template <class S>
Array<T> Multigrid<T>::converted(const Array<S>& from) const {
  auto to = queue_.array<T>(from.size());
  if constexpr (std::is_same_v<S, T>)
    queue_.copy(from, to);
  else
    queue_.kernel("galerkin", "to_float", precision_of<S>)({{from.size()}, {64}}, from, to,
                                                           static_cast<int>(from.size()));
  return to;
}

template <class T>
template <class S>
void Multigrid<T>::set_level(std::size_t index, const Array<S>& stencil,
                             const std::vector<std::uint8_t>& free) {
  Level& level = *levels_[index];
  const std::size_t nodes = level.nodes();
  auto inverse = queue_.array<S>(4 * nodes);
  queue_.kernel("galerkin", "invert_diagonal", precision_of<S>)({{nodes}, {64}}, stencil, inverse,
                                                                static_cast<int>(nodes));
  level.free = mask_array<T>(queue_, free);
  level.stencil = std::make_shared<Array<T>>(converted(stencil));
  level.inverse_diagonal = converted(inverse);
  if (index + 1 == levels_.size()) {
    const std::vector<S> host = queue_.read(stencil);
    return invert_coarsest({host.begin(), host.end()});
  }
  bound_eigenvalues(level);
  // A_c = P^T A P
  const Level& next = *levels_[index + 1];
  const auto coarse_free = coarse_mask(free, level.to_coarse.x, level.to_coarse.y);
  const LineArrays<S> x(queue_, level.to_coarse.x), y(queue_, level.to_coarse.y);
  auto coarse = queue_.array<S>(36 * next.nodes());
  queue_.kernel("galerkin", "galerkin_product", precision_of<S>)(
      grid_range(next.lines.x.size(), next.lines.y.size(), 9), stencil, coarse, x.at, y.at, x.left, x.weight,
      y.left, y.weight, mask_array<S>(queue_, free), mask_array<S>(queue_, coarse_free), level.nx, level.ny,
      next.nx, next.ny);
  set_level(index + 1, coarse, coarse_free);
}

// Largest eigenvalue of D^-1 A by power iteration, as the Rayleigh quotient (A v, D^-1 A v) / (v, A v).
template <class T>
void Multigrid<T>::bound_eigenvalues(Level& level) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<T> start = queue_.read(level.free);
  for (T& value : start) value *= static_cast<T>(uniform(random));
  Array<T> v = queue_.array(start), av = queue_.array<T>(start.size()),
           unused = queue_.array<T>(start.size());
  const Range range = grid_range(level.lines.x.size(), level.lines.y.size(), 1);
  for (unsigned k = 0;; ++k) {
    kernels_->apply(range, *level.stencil, v, av, level.nx, level.ny);
    if (k == kPowerIterations) break;
    kernels_->first(range, level.inverse_diagonal, av, unused, v, T{1}, level.nx, level.ny);
  }
  const std::vector<T> before = queue_.read(v), product = queue_.read(av);
  kernels_->first(range, level.inverse_diagonal, av, unused, v, T{1}, level.nx, level.ny);
  const double largest = dot(product, queue_.read(v)) / dot(before, product);
  if (!(largest > 0) || !std::isfinite(largest))
    throw std::invalid_argument("multigrid: the operator is not symmetric positive definite");
  level.eigenvalue_bound = kBoundMargin * largest;
  level.steps = chebyshev_steps(level.eigenvalue_bound / options_.smoothing_range, level.eigenvalue_bound,
                                std::max(1U, options_.smoothing_steps));
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
    for (Array<T>* a : {&level.direction, &level.other, &level.residual}) *a = queue_.array<T>(size);
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

// Polynomial smoothing of `*at`, which moves between the two arrays.
template <class T>
void Multigrid<T>::smooth(Level& level, const Array<T>& r, Array<T>*& at, Array<T>*& spare, std::size_t count,
                          bool from_zero) {
  const Range range = grid_range(level.lines.x.size(), level.lines.y.size(), count);
  if (from_zero)
    kernels_->first(range, level.inverse_diagonal, r, level.direction, *at,
                    static_cast<T>(level.steps[0].new_residual), level.nx, level.ny);
  for (std::size_t k = from_zero ? 1 : 0; k < level.steps.size(); ++k, std::swap(at, spare))
    kernels_->step(range, *level.stencil, level.inverse_diagonal, r, *at, level.direction, *spare,
                   static_cast<T>(level.steps[k].old_direction), static_cast<T>(level.steps[k].new_residual),
                   level.nx, level.ny);
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
  // Smoothing changes places 2 steps - 1 times, an odd number: begun in `other`, it ends in z.
  Array<T>*at = &level.other, *spare = &z;
  // z = S r
  smooth(level, r, at, spare, count, true);
  // r_c = P^T (r - A z)
  kernels_->residual(fine, *level.stencil, r, *at, level.residual, level.nx, level.ny);
  kernels_->restriction(grid_range(next.lines.x.size(), next.lines.y.size(), count), level.residual, next.r,
                        level.x->at, level.x->around, level.y->at, level.y->around, next.free, level.nx,
                        level.ny, next.nx, next.ny);
  cycle(index + 1, next.r, next.z, count);
  // z += P z_c
  kernels_->prolong(fine, next.z, *at, level.x->left, level.x->weight, level.y->left, level.y->weight,
                    level.free, level.nx, level.ny, next.nx, next.ny);
  // z += S^T (r - A z)
  smooth(level, r, at, spare, count, false);
}

template class Multigrid<float>;
template class Multigrid<double>;
template void Multigrid<float>::set_operator(const Array<float>&, const std::vector<std::uint8_t>&);
template void Multigrid<float>::set_operator(const Array<double>&, const std::vector<std::uint8_t>&);
template void Multigrid<double>::set_operator(const Array<double>&, const std::vector<std::uint8_t>&);

}  // namespace teletact::service
