#include "service/solver/multigrid.h"

#include <algorithm>
#include <initializer_list>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>

#include "service/solver/smoother.h"

namespace teletact::service {
namespace {

constexpr unsigned kSmoothingSteps = 3;      // degree of the Chebyshev polynomial
constexpr double kSmoothingRange = 10;       // it damps eigenvalues of M A in [largest / this, largest]
constexpr std::size_t kCoarsestNodes = 100;  // a level of at most so many nodes is solved exactly

template <class T>
std::vector<T> as(const auto& values) {
  return {values.begin(), values.end()};
}

template <class T>
std::vector<T> joined(std::initializer_list<const std::vector<T>*> parts) {
  std::vector<T> all;
  for (const std::vector<T>* part : parts) all.insert(all.end(), part->begin(), part->end());
  return all;
}

// A copy of `from` as T: S or float.
template <class T, class S>
Array<T> converted(const Queue& queue, const Array<S>& from) {
  auto to = queue.array<T>(from.size());
  if constexpr (std::is_same_v<S, T>)
    queue.copy(from, to);
  else
    queue.kernel("galerkin", "to_float", precision_of<S>)({{from.size()}, {64}}, from, to,
                                                          static_cast<int>(from.size()));
  return to;
}

// A level of at most so many nodes is worked on by one work-group: launches would cost more than they share
// out.
std::size_t small_level(const Queue& queue) {
  return queue.info().gpu ? 1100 : 4000;
}

// That work-group. A processor runs the items of a group one after the other: one does it all.
std::size_t group_of(const Queue& queue) {
  return queue.info().gpu ? std::min<std::size_t>(256, queue.info().max_group) : 1;
}

template <class T, class W>
Defines defines_of(const Queue& queue) {
  return {{"WIDTH", std::to_string(queue.info().width<W>())},
          {"GROUP", std::to_string(group_of(queue))},
          {"OUTER", sizeof(T) == sizeof(double) ? "double" : "float"}};
}

// A coarse unknown is constrained where the fine one at its place is.
std::vector<std::uint8_t> coarse_mask(const std::vector<std::uint8_t>& fine, const GridTransfer& t) {
  std::vector<std::uint8_t> coarse;
  for (const int j : t.y.at)
    for (const int i : t.x.at) {
      const std::size_t node = static_cast<std::size_t>(i) + t.x.left.size() * static_cast<std::size_t>(j);
      coarse.push_back(fine[2 * node]);
      coarse.push_back(fine[2 * node + 1]);
    }
  return coarse;
}

}  // namespace

template <class T, class W>
Multigrid<T, W>::Multigrid(const Queue& queue, const NodeLines& lines)
    : queue_(queue), short_side_(short_side(lines)) {
  const double largest = smooths_lines() ? kLargestLineEigenvalue : kLargestCellEigenvalue;
  steps_ = chebyshev_steps(largest / kSmoothingRange, largest, kSmoothingSteps);
  lines_.push_back(lines);
  for (double spacing = smallest_spacing(lines);; spacing *= 2) {
    const NodeLines& fine = lines_.back();
    GridTransfer transfer = smooths_lines() ? coarsen_fully(fine) : coarsen(fine, spacing);
    NodeLines coarse{transfer.x.coarse, transfer.y.coarse};
    if (fine.nodes() <= kCoarsestNodes || coarse.nodes() == fine.nodes()) break;
    transfers_.push_back(std::move(transfer));
    lines_.push_back(std::move(coarse));
  }
  layout_ = lay_out(lines_, transfers_, queue.info().width<W>(), 2 * steps_.size());
  plan_ = plan_cycle(levels(), steps_.size());
  while (first_small_ + 1 < levels() &&
         (smooths_lines() || lines_[first_small_].nodes() > small_level(queue)))
    ++first_small_;
  std::vector<int> table = layout_.table;
  for (const PlannedStep& s : plan_) table.insert(table.end(), {static_cast<int>(s.step), s.level, s.k});
  table_ = queue_.array(table);
  constants_ = queue_.array<W>(static_cast<std::size_t>(layout_.constants_size));
  const auto get = [&](const char* name) {
    return queue.kernel("multigrid", name, precision_of<W>, defines_of<T, W>(queue));
  };
  residual_ = get("residual");
  smooth_ = get("smooth");
  restriction_ = get("restrict_residual");
  prolong_ = get("prolong_add");
  run_ = get("run_steps");
  pack_ = get("vectors_to_planes");
  unpack_ = get("planes_to_vectors");
  if (!smooths_lines()) return;
  solve_lines_ = queue.kernel("lines", "solve_lines", precision_of<W>);
  line_step_ = queue.kernel("lines", "line_step", precision_of<W>);
}

template <class T, class W>
template <class S>
void Multigrid<T, W>::set_operator(const Array<S>& stencil, const std::vector<std::uint8_t>& free) {
  std::vector<std::vector<std::uint8_t>> masks{free};
  for (const GridTransfer& t : transfers_) masks.push_back(coarse_mask(masks.back(), t));
  set_header(masks);
  std::vector<Level<S>> setup(levels());
  for (std::size_t l = 0; l < levels(); ++l) {
    Level<S>& level = setup[l];
    level.free = queue_.array(as<S>(masks[l]));
    if (l + 1 == levels()) break;
    const GridTransfer& t = transfers_[l];
    level.lines = queue_.array(joined<int>({&t.x.at, &t.y.at, &t.x.left, &t.y.left}));
    level.weights = queue_.array(as<S>(joined<double>({&t.x.weight, &t.y.weight})));
  }
  std::vector<Array<S>> coarser;  // operators of the levels below the finest
  const auto at = [&](std::size_t l) -> const Array<S>& { return l == 0 ? stencil : coarser[l - 1]; };
  for (std::size_t l = 0; l + 1 < levels(); ++l) coarser.push_back(coarse_operator(l, at(l), setup));
  const std::vector<S> coarsest = queue_.read(at(levels() - 1));
  // The device works at the smoothers while the host inverts.
  Array<int> indefinite = queue_.array(std::vector<int>{0});
  line_factors_.clear();
  for (std::size_t l = 0; l + 1 < levels(); ++l) set_level(l, at(l), indefinite);
  invert_coarsest({coarsest.begin(), coarsest.end()});
  if (queue_.read(indefinite)[0])
    throw std::invalid_argument("multigrid: the operator is not symmetric positive definite");
}

// The beginning of the constants, which does not depend on the operator.
template <class T, class W>
void Multigrid<T, W>::set_header(const std::vector<std::vector<std::uint8_t>>& free) {
  std::vector<W> header(static_cast<std::size_t>(layout_.header_size));
  for (std::size_t k = 0; k < steps_.size(); ++k) {
    header[2 * k] = static_cast<W>(steps_[k].old_direction);
    header[2 * k + 1] = static_cast<W>(steps_[k].new_residual);
  }
  for (std::size_t l = 0; l < levels(); ++l) {
    const LevelLayout& level = layout_.levels[l];
    const auto put = [&](const std::vector<double>& values, int at) {
      for (const double value : values) header[static_cast<std::size_t>(at++)] = static_cast<W>(value);
    };
    if (l + 1 < levels()) {
      put(transfers_[l].x.around, level.around_x);
      put(transfers_[l].y.around, level.around_y);
    }
    for (std::size_t n = 0; n < free[l].size() / 2; ++n) {
      const auto i = static_cast<int>(n) % level.nx, j = static_cast<int>(n) / level.nx;
      const auto at = static_cast<std::size_t>(level.free + level.first() + i + level.pitch * j);
      header[at] = free[l][2 * n];
      header[at + static_cast<std::size_t>(level.stride)] = free[l][2 * n + 1];
    }
  }
  queue_.send(constants_, std::move(header));
}

// Operator and smoother of a level.
template <class T, class W>
template <class S>
void Multigrid<T, W>::set_level(std::size_t index, const Array<S>& stencil, Array<int>& indefinite) {
  const LevelLayout& level = layout_.levels[index];
  const std::size_t nx = lines_[index].x.size(), ny = lines_[index].y.size();
  queue_.kernel("planes", "stencil_to_planes", precision_of<S>, planes_of<W>())(
      {{static_cast<std::size_t>(level.stride)}, {64}}, stencil, constants_, level.stencil, level.stride,
      level.nx, level.ny);
  if (smooths_lines())
    line_factors_.push_back(
        converted<W>(queue_, line_factor(queue_, stencil, nx, ny, short_side_ == ShortSide::kX, indefinite)));
  else
    cell_smoother(queue_, stencil, nx, ny, indefinite, constants_, level.smoother, level.stride);
}

// P^T A P, and P itself where it is more than bilinear.
template <class T, class W>
template <class S>
Array<S> Multigrid<T, W>::coarse_operator(std::size_t index, const Array<S>& stencil,
                                          const std::vector<Level<S>>& setup) {
  const LevelLayout &level = layout_.levels[index], &next = layout_.levels[index + 1];
  const Level<S>& s = setup[index];
  const std::size_t nx = lines_[index + 1].x.size(), ny = lines_[index + 1].y.size();
  auto rows = queue_.array<S>(16 * (nx - 1) * (ny - 1)), coarse = queue_.array<S>(36 * nx * ny);
  queue_.kernel("galerkin", "interior_rows", precision_of<S>)(grid_range(nx - 1, ny - 1, 1), stencil, rows,
                                                              s.lines, s.weights, s.free, level.nx, level.ny,
                                                              next.nx, next.ny);
  queue_.kernel("planes", "inside_to_planes", precision_of<S>, planes_of<W>())(
      {{static_cast<std::size_t>(next.stride)}, {64}}, stencil, rows, s.free, s.lines, s.weights, constants_,
      level.inside, next.stride, level.nx, level.ny, next.nx, next.ny);
  queue_.kernel("galerkin", "galerkin_product", precision_of<S>)(
      grid_range(nx, ny, 5), stencil, rows, coarse, s.lines, s.weights, s.free, setup[index + 1].free,
      level.nx, level.ny, next.nx, next.ny);
  return coarse;
}

template <class T, class W>
void Multigrid<T, W>::invert_coarsest(const std::vector<double>& stencil) {
  const LevelLayout& level = layout_.levels.back();
  const auto nx = static_cast<std::size_t>(level.nx), ny = static_cast<std::size_t>(level.ny);
  const std::size_t nodes = nx * ny, n = 2 * nodes;
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
  // As kernels/multigrid.cl wants it: [component][place][component][place], rows of whole work items.
  const std::size_t width = queue_.info().width<W>(), span = static_cast<std::size_t>(level.span());
  const std::size_t row = (span + width - 1) / width * width;
  std::vector<W> padded(4 * span * row);
  const auto place = [&](std::size_t node) { return node % nx + (nx + 1) * (node / nx); };
  for (std::size_t a = 0; a < n; ++a)
    for (std::size_t b = 0; b < n; ++b)
      padded[(2 * (a % 2 * span + place(a / 2)) + b % 2) * row + place(b / 2)] =
          static_cast<W>(dense[a * n + b]);
  queue_.send(constants_, std::move(padded), static_cast<std::size_t>(level.stencil));
}

template <class T, class W>
void Multigrid<T, W>::reserve(std::size_t count) {
  if (count <= reserved_) return;
  vectors_ = queue_.array<W>(count * static_cast<std::size_t>(layout_.vectors_size));
  queue_.fill_zero(vectors_);  // what lies between nodes stays so
  if (smooths_lines()) line_solutions_ = queue_.array<W>(count * 4 * 2 * lines_.front().nodes());
  reserved_ = count;
}

template <class T, class W>
void Multigrid<T, W>::apply(const Array<T>& r, Array<T>& z, std::size_t count) {
  reserve(count);
  const std::size_t group = group_of(queue_);
  for (std::size_t s = 0; s < plan_.size();) {
    const auto small = [&](std::size_t at) {
      return at < plan_.size() && static_cast<std::size_t>(plan_[at].level) >= first_small_;
    };
    if (!small(s)) {
      launch(plan_[s++], r, z, count);
      continue;
    }
    const std::size_t from = s;
    while (small(s)) ++s;
    run_({{group, count}, {group}}, constants_, vectors_, table_, r, z,
         static_cast<int>(layout_.table.size()), static_cast<int>(from), static_cast<int>(s),
         layout_.vectors_size);
  }
}

// A step on a level that is not small.
template <class T, class W>
void Multigrid<T, W>::launch(const PlannedStep& s, const Array<T>& r, Array<T>& z, std::size_t count) {
  const LevelLayout& level = layout_.levels[static_cast<std::size_t>(s.level)];
  const std::size_t width = queue_.info().width<W>(), span = static_cast<std::size_t>(level.span());
  const Range over_nodes{{(span + width - 1) / width, count}, {width > 1 ? 8U : 64U}};
  const auto by_rows = [&](const LevelLayout& of) -> Range {  // kernels/levels.clh, row_items
    if (width > 1) return {{static_cast<std::size_t>(of.ny), count}, {4}};
    return {{static_cast<std::size_t>(of.span()), count}, {64}};
  };
  const auto next = [&] { return by_rows(layout_.levels[static_cast<std::size_t>(s.level) + 1]); };
  switch (s.step) {
    case CycleStep::kResidual:
      return residual_(over_nodes, constants_, vectors_, table_, s.level, layout_.vectors_size);
    case CycleStep::kSmooth:
    case CycleStep::kSmoothFromZero:
      if (smooths_lines()) return smooth_lines(s, count);
      return smooth_(over_nodes, constants_, vectors_, table_, s.level, layout_.vectors_size, s.k,
                     static_cast<int>(s.step == CycleStep::kSmoothFromZero));
    case CycleStep::kRestrict:
      return restriction_(next(), constants_, vectors_, table_, s.level, layout_.vectors_size);
    case CycleStep::kProlong:
      return prolong_(next(), constants_, vectors_, table_, s.level, layout_.vectors_size);
    case CycleStep::kPack:
      return pack_(by_rows(level), r, vectors_, table_, layout_.vectors_size);
    case CycleStep::kUnpack:
      return unpack_(by_rows(level), vectors_, z, table_, layout_.vectors_size);
    case CycleStep::kSolve:
      throw std::logic_error("multigrid: the coarsest level is always small");
  }
}

template <class T, class W>
void Multigrid<T, W>::smooth_lines(const PlannedStep& s, std::size_t count) {
  const auto index = static_cast<std::size_t>(s.level);
  const std::size_t nx = lines_[index].x.size(), ny = lines_[index].y.size();
  const bool along_x = short_side_ == ShortSide::kX, from_zero = s.step == CycleStep::kSmoothFromZero;
  const std::size_t lines = (along_x ? ny : nx) - 1;
  solve_lines_({{lines, count}, {8}}, line_factors_[index], vectors_, line_solutions_, table_, s.level,
               layout_.vectors_size, static_cast<int>(along_x), static_cast<int>(from_zero));
  line_step_(grid_range(nx, ny, count), constants_, line_solutions_, vectors_, table_, s.level,
             layout_.vectors_size, static_cast<int>(along_x), s.k, static_cast<int>(from_zero));
}

template class Multigrid<float>;
template class Multigrid<double>;
template class Multigrid<double, float>;
template void Multigrid<float>::set_operator(const Array<float>&, const std::vector<std::uint8_t>&);
template void Multigrid<float>::set_operator(const Array<double>&, const std::vector<std::uint8_t>&);
template void Multigrid<double>::set_operator(const Array<double>&, const std::vector<std::uint8_t>&);
template void Multigrid<double, float>::set_operator(const Array<double>&, const std::vector<std::uint8_t>&);

}  // namespace teletact::service
