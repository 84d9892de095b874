// One file: both ways of an iteration, a processor's and a GPU's, are read against each other.
#include "service/tissue/solid/solid_solver.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "service/tissue/solid/radau_bound.h"
#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {
namespace {

// Of kernels/solid_marks.clh.
constexpr std::size_t kAlpha = 1, kMarksOfIteration = 2, kParts = 4;

constexpr std::size_t kMaxChunks = 512;
constexpr std::size_t kLargestGroup = 128;    // over a row of nodes on a GPU
constexpr std::size_t kAlong = 8, kDown = 4;  // z and rows of nodes of an item on a processor
constexpr std::size_t kOfNode = 192;          // products of an unknown's force on a GPU

// The largest relative error, in energy, that rounding was found to leave (T8.3): of the stiffness in T,
// magnified as nu nears 1/2, and by contrast (bench solid bound, in float at nu 0.3, 0.49 and 0.4999: 1.1e-6,
// 1.3e-5 and 8.7e-4 at contrast 10, 1.3e-4, 4e-4 and 5.1e-2 at 1000).
template <class T>
double rounding_of(double poisson_ratio, const LayeredTissue& beside) {
  constexpr double kOfStiffness = 4, kMagnifies = 45;
  const double epsilon = static_cast<double>(std::numeric_limits<T>::epsilon());
  const double beyond = beside.largest / beside.least - 1;
  return epsilon * (kOfStiffness / (1 - 2 * poisson_ratio) * (1 + beyond / kMagnifies) + beyond);
}

std::size_t lanes(const Queue& queue, std::size_t nx, std::size_t bytes) {
  return std::min<std::size_t>({nx, 16, std::max<std::size_t>(1, queue.info().vector_bytes / bytes)});
}

// Terms that an item adds up where `items` add up so many parts (kernels/sums.clh).
std::size_t chain_of(std::size_t parts, std::size_t items) {
  return items > 1 ? parts / (2 * items) + std::bit_width(items) : parts / 16 + 20;
}

// Of a matrix of so many rows by items, two products of a row at once.
std::size_t chain_of_products(std::size_t rows, std::size_t items) {
  return (rows + items - 1) / items * ((rows + 1) / 2);
}

// Of iteration k the turn before; -1: there is none.
int turn_before(std::size_t k) {
  return k == 0 ? -1 : static_cast<int>((k - 1) % 2);
}

}  // namespace

double SolidSolution::bounded_error() const {
  const double energy = energy_j - energy_error_j;  // at least
  return energy > 0 ? std::sqrt(energy_error_j / energy) : energy_error_j > 0 ? HUGE_VAL : 0;
}

template <class T>
SolidModulus<T>::SolidModulus(const Queue& queue, const SolidTissue& tissue, LayeredTissue beside)
    : layers((validate(tissue), std::move(beside))), rounding(rounding_of<T>(tissue.poisson_ratio, layers)) {
  const std::vector<double>& pa = tissue.youngs_modulus_pa;
  youngs_modulus_pa = queue.array(std::vector<T>(pa.begin(), pa.end()));
}

template <class T>
SolidSolver<T>::SolidSolver(const Queue& queue, const SolidTissue& tissue)
    : queue_(queue),
      grid_((validate(tissue), tissue.grid)),
      modulus_(std::make_shared<const SolidModulus<T>>(queue, tissue, layered(tissue))),
      preconditioner_(queue, grid_, modulus_->layers, tissue.poisson_ratio),
      row_(std::make_shared<const SolidRow>(SolidRow{0, preconditioner_.surface_compliance()})),
      ahead_(preconditioner_.fourier().group() > 0),
      width_(lanes(queue, grid_.nx, sizeof(T))),
      group_(ahead_ ? std::min(grid_.nx, kLargestGroup) : 1),
      nx_(static_cast<int>(grid_.nx)),
      nz_(static_cast<int>(grid_.nz)),
      rows_(static_cast<int>(grid_.layers())),
      groups_(static_cast<int>(grid_.unknowns() / width_)) {
  const std::size_t layers = grid_.layers(), columns = grid_.columns(), unknowns = grid_.unknowns();
  const std::size_t groups = unknowns / width_, wide = grid_.nx + width_;
  chunk_ = (groups + kMaxChunks - 1) / kMaxChunks;
  chunks_ = (groups + chunk_ - 1) / chunk_;
  std::vector<T> stiffness;
  for (std::size_t j = 0; j < layers; ++j) {
    const HexahedronMatrix k = layer_stiffness(grid_, j, tissue.poisson_ratio);
    if (ahead_) {
      stiffness.insert(stiffness.end(), k.data(), k.data() + k.size());  // symmetric: rows are columns
    } else {
      const std::array<double, 72> blocks = parity_blocks(k);
      stiffness.insert(stiffness.end(), blocks.begin(), blocks.end());
    }
  }
  stiffness_ = queue.array(stiffness);
  for (Array<T>* field : {&z_, &kd_}) *field = queue.array<T>(unknowns);
  for (std::size_t k = 0; k <= at(1); ++k) {
    u_[k] = queue.array<T>(unknowns), r_[k] = queue.array<T>(unknowns);
    d_[k] = queue.array<T>(ahead_ ? unknowns : 3 * (layers + 1) * grid_.nz * wide);
    queue_.fill_zero(d_[k]);
  }
  surface_ = queue.array<T>(3 * columns);
  const Range rows = preconditioner_.fourier().over_rows(3 * layers);
  parts_ = static_cast<int>(ahead_ ? (rows.global[0] + rows.local[0] - 1) / rows.local[0] : chunks_);
  marks_ = queue.array(std::vector<T>(kParts + static_cast<std::size_t>(parts_), T{0}));
  partial_ = queue.array<T>(std::max(chunks_, layers * grid_.nz));
  slots_ = queue.array<int>(3 * columns);
  const Defines defines{{"WIDTH", std::to_string(width_)},
                        {"GROUP", std::to_string(group_)},
                        {"ALONG", std::to_string(kAlong)},
                        {"DOWN", std::to_string(kDown)}};
  const auto get = [&](const char* name) { return queue.kernel("solid", name, precision_of<T>, defines); };
  dot_ = get("solid_dot");
  sum_ = get("solid_add");
  add_ = get("patch_add");
  project_ = get("patch_project");
  spread_ = get("patch_spread");
  if (!ahead_) {
    apply_ = get("solid_apply");
    direction_ = get("solid_direction");
    step_ = get("solid_step");
    return;
  }
  apply_ = get("solid_advance");
  const auto joined = [&](const char* name) {
    return queue.kernel("solid_groups", name, precision_of<T>, preconditioner_.fourier().defines());
  };
  step_ = joined("step_forward");
  back_ = joined("backward_dot");
  surface_step_ = joined("patch_surface");
}

template <class T>
auto SolidSolver<T>::set_patch(const std::vector<std::size_t>& unknowns, bool pushed) -> Patch {
  const std::size_t columns = grid_.columns(), n = unknowns.size(), begin = row_begin();
  if (n == 0) throw std::invalid_argument("patch: no unknowns; give at least one");
  std::vector<int> slots(3 * columns, -1), at;
  for (const std::size_t unknown : unknowns) {
    if (unknown >= 3 * columns || slots[unknown] >= 0)
      throw std::invalid_argument(
          fmt::format("patch: unknown {} is none of the surface's {}, or there twice", unknown, 3 * columns));
    slots[unknown] = static_cast<int>(at.size());
    at.push_back(static_cast<int>(begin + unknown));
  }
  if (unknowns_.size() < n) {
    // All of them or, where there is no room, none.
    auto unknowns = queue_.array<int>(2 * n);
    auto q = queue_.array<T>(2 * n), dq = queue_.array<T>(2 * n), p = queue_.array<T>(2 * n);
    auto next_p = queue_.array<T>(ahead_ ? 2 * n : 1), inverse = queue_.array<T>(4 * n * n);
    unknowns_ = std::move(unknowns), q_ = std::move(q), dq_ = std::move(dq);
    p_ = {std::move(p), std::move(next_p)};
    inverse_ = std::move(inverse);
  }
  queue_.write(unknowns_, at.data(), n);
  queue_.write(slots_, slots.data(), slots.size());
  const auto [low, high] = std::minmax_element(unknowns.begin(), unknowns.end());
  return {static_cast<int>(n), {*low / columns, *high / columns - *low / columns + 1}, pushed};
}

template <class T>
void SolidSolver<T>::spread(const Array<T>& values, Array<T>& field, T sign, const Components& components,
                            std::size_t begin) {
  const auto first = static_cast<int>(components.first * grid_.columns());
  const auto end = static_cast<int>((components.first + components.count) * grid_.columns());
  spread_({{static_cast<std::size_t>(end - first)}, {64}}, slots_, values, field, sign, first, end,
          static_cast<int>(begin));
}

template <class T>
void SolidSolver<T>::solve_layers(const Array<T>& r, Array<T>& z) {
  preconditioner_.up(r, {0, 0}, surface_);
  preconditioner_.down(surface_, {0, 0}, z);
}

template <class T>
void SolidSolver<T>::move_layers(const Components& components, Array<T>& u) {
  if (row_->index == 0) {
    spread(p_[last_p_], surface_, T{1}, components, 0);
    preconditioner_.solve_surface(surface_, components, u);
    return;
  }
  queue_.fill_zero(kd_);
  spread(p_[last_p_], kd_, T{1}, {0, 3}, row_begin());
  solve_layers(kd_, u);
}

template <class T>
void SolidSolver<T>::sum_products(const Array<T>& a, const Array<T>& b, Array<T>& sums, std::size_t first) {
  dot_({{chunks_ * group_}, {group_}, chunk_ / group_ + std::bit_width(group_)}, a, b, sums,
       static_cast<int>(first), groups_, static_cast<int>(chunk_));
}

template <class T>
double SolidSolver<T>::dot(const Array<T>& a, const Array<T>& b) {
  sum_products(a, b, partial_, 0);
  std::vector<T> sums(chunks_);
  queue_.read(partial_, sums.data(), chunks_);
  double sum = 0;
  for (const T s : sums) sum += static_cast<double>(s);
  return sum;
}

template <class T>
void SolidSolver<T>::turn(const Array<T>& z, int parts, int patch_row, std::size_t k) {
  const auto rows = static_cast<std::size_t>(rows_), nz = static_cast<std::size_t>(nz_);
  const auto own = static_cast<int>(k % 2);
  const int earlier = parts > 0 ? turn_before(k) : -1;
  const std::size_t chain = chain_of(static_cast<std::size_t>(parts), group_);
  if (ahead_)
    return apply_({{group_, nz, rows}, {group_}, std::max(chain, kOfNode)}, stiffness_,
                  modulus_->youngs_modulus_pa, marks_, z, d_[at(k + 1)], d_[at(k)], kd_, partial_, slots_, q_,
                  dq_, nx_, nz_, rows_, parts, patch_row, earlier, own);
  direction_({{3 * rows}, {1}, chain}, marks_, z, d_[0], slots_, q_, dq_, nx_, nz_, 3 * rows_, parts,
             patch_row, earlier, own);
  const std::size_t dot = 3 * static_cast<std::size_t>(nx_) / width_;
  apply_({{(nz + kAlong - 1) / kAlong, (rows + kDown - 1) / kDown}, {1}, dot}, stiffness_,
         modulus_->youngs_modulus_pa, d_[0], kd_, partial_, slots_, dq_, nx_, nz_, rows_, patch_row);
}

template <class T>
void SolidSolver<T>::add_patch(const Array<T>& values, const Array<T>& field, Array<T>& out, T of_field,
                               T sign) {
  add_({{grid_.unknowns()}, {64}}, slots_, values, field, out, of_field, sign, static_cast<int>(row_begin()),
       static_cast<int>(3 * grid_.columns()), static_cast<int>(grid_.unknowns()));
}

template <class T>
void SolidSolver<T>::write_forces(const Patch& patch, const Eigen::VectorXd& force_n) {
  const Eigen::Matrix<T, Eigen::Dynamic, 1> force = force_n.cast<T>();
  queue_.write(p_[0], force.data(), static_cast<std::size_t>(patch.count));
}

template <class T>
void SolidSolver<T>::begin(const Patch& patch, const Eigen::VectorXd& force_n) {
  last_ = last_p_ = 0;
  write_forces(patch, force_n);
  move_layers(patch.components, u_[0]);
  turn(u_[0], 0, -1, 0);
  add_patch(p_[0], kd_, r_[0], T{-1}, T{1});
}

template <class T>
void SolidSolver<T>::begin_from_last(const Patch& patch, const Eigen::VectorXd& more_n,
                                     const Eigen::VectorXd& force_n) {
  if (at(last_) != 0) std::swap(u_[0], u_[1]);
  last_ = last_p_ = 0;
  if (!more_n.isZero(0)) {
    write_forces(patch, more_n);
    move_layers(patch.components, z_);
    sum_({{static_cast<std::size_t>(groups_)}, {64}}, u_[0], z_, groups_);
  }
  write_forces(patch, force_n);
  turn(u_[0], 0, -1, 0);
  add_patch(p_[0], kd_, r_[0], T{-1}, T{1});
}

template <class T>
void SolidSolver<T>::project(const Patch& patch, const Array<T>& field, std::size_t k) {
  const std::size_t now = at(k), then = k == 0 ? now : at(k - 1);
  const auto count = static_cast<std::size_t>(patch.count);
  project_({{count}, {1}, chain_of_products(count, count)}, inverse_, unknowns_, field, q_, dq_, p_[then],
           p_[now], marks_, patch.count, turn_before(k));
}

template <class T>
void SolidSolver<T>::precondition(const Patch& patch, std::size_t k) {
  if (ahead_) return precondition_joined(patch, k);
  Array<T>& r = r_[0];
  if (k > 0) {
    const std::size_t planes = 3 * grid_.layers(), products = grid_.layers() * grid_.nz;
    step_({{planes}, {1}, chain_of(products, 1)}, d_[0], kd_, u_[0], r, partial_, marks_, nx_, nz_,
          static_cast<int>(planes), static_cast<int>(products), turn_before(k));
  }
  if (!patch.pushed || row_->index > 0) {
    solve_layers(r, z_);
  } else {
    preconditioner_.up(r, patch.components, surface_);
    project(patch, surface_, k);
    spread(q_, surface_, T{-1}, patch.components, 0);
    preconditioner_.down(surface_, patch.components, z_);
  }
  if (patch.pushed && row_->index > 0) {
    // No condition enters between the sweeps: q from z0, and the layers again, under r - B^T q.
    project(patch, z_, k);
    add_patch(q_, r, kd_, T{1}, T{-1});
    solve_layers(kd_, z_);
  }
  sum_products(r, z_, marks_, kParts);
}

// The same in fewer launches.
template <class T>
void SolidSolver<T>::precondition_joined(const Patch& patch, std::size_t k) {
  Fourier<T>& fourier = preconditioner_.fourier();
  Array<T>& spectrum = preconditioner_.spectrum();
  const auto planes = static_cast<std::size_t>(3 * rows_);
  const int count = static_cast<int>(planes), earlier = turn_before(k);
  const std::size_t now = at(k), then = k == 0 ? now : at(k - 1), items = fourier.group();
  const auto products = static_cast<int>(planes / 3 * grid_.nz);  // of K d by d, in parts
  Range rows = fourier.over_rows(planes), back = rows;
  rows.chain = chain_of(static_cast<std::size_t>(products), items);
  back.chain = 16;
  step_(rows, d_[then], kd_, u_[then], u_[now], r_[then], r_[now], partial_, marks_, spectrum,
        fourier.roots(), count, products, earlier);
  fourier.columns(spectrum, 0, planes, false);
  const bool surface = patch.pushed && row_->index == 0;
  const Components components = surface ? patch.components : Components{0, 0};
  preconditioner_.eliminate(components);
  if (surface)
    surface_step_({{items}, {items}, chain_of_products(static_cast<std::size_t>(patch.count), items)},
                  preconditioner_.surface_spectrum(), surface_, fourier.roots(), inverse_, unknowns_, slots_,
                  q_, dq_, p_[then], p_[now], marks_, static_cast<int>(components.first),
                  static_cast<int>(components.count), patch.count, earlier);
  preconditioner_.substitute(components);
  if (patch.pushed && !surface) {
    fourier.backward(spectrum, z_, 0, planes);
    project(patch, z_, k);
    add_patch(q_, r_[now], kd_, T{1}, T{-1});
    fourier.forward(kd_, spectrum, 0, planes);
    preconditioner_.eliminate(components);
    preconditioner_.substitute(components);
  }
  fourier.columns(spectrum, 0, planes, true);
  back_(back, spectrum, z_, r_[now], marks_, fourier.roots(), count);
}

template <class T>
SolidSolution SolidSolver<T>::iterate(const Patch& patch, double twice_energy, const SolidOptions& options) {
  const bool ahead = ahead_ && !options.watch;
  const int patch_row = patch.pushed ? static_cast<int>(row_->index) : -1;
  std::array<std::vector<T>, 2> marks;
  for (auto& of : marks) of.resize(marks_.size());
  std::array<Arrival, 2> on_their_way;
  const auto ask = [&](std::size_t k) {
    precondition(patch, k);
    if (ahead) on_their_way[k % 2] = queue_.fetch(marks_, marks[k % 2].data(), marks_.size());
  };
  const auto go_on = [&](std::size_t k) {
    turn(z_, parts_, patch_row, k);
    ask(k + 1);
  };
  SolidSolution solution;
  RadauBound bound(layers().least);
  double rho = 0;
  ask(0);
  for (std::size_t k = 0;; ++k) {
    last_ = k, last_p_ = patch.pushed ? at(k) : 0;
    if (ahead && k < options.max_iterations) go_on(k);
    if (ahead)
      on_their_way[k % 2].wait();
    else
      queue_.read(marks_, marks[k % 2].data(), marks_.size());
    const std::vector<T>& own = marks[k % 2];
    const double next = std::accumulate(own.begin() + kParts, own.end(), 0.0);
    const auto alpha = static_cast<double>(own[kMarksOfIteration * ((k + 1) % 2) + kAlpha]);
    if (k > 0) {
      twice_energy += (patch.pushed ? -1 : 1) * alpha * rho;
      bound.step(alpha, rho, next);
    }
    rho = next;
    solution.iterations = k;
    solution.energy_j = twice_energy / 2;
    solution.energy_error_j = bound.squared(rho) / 2;
    solution.certified = bound.holds();
    solution.rounding = rounding();
    if (!std::isfinite(rho) || !std::isfinite(twice_energy))
      solution.reason = StopReason::kNotFinite;
    else if (rho < 0 || (k > 0 && !(alpha > 0)))
      solution.reason = StopReason::kIndefinite;
    else if (options.watch && !options.watch(solution))
      solution.reason = StopReason::kIterationLimit;
    else if (rho == 0 || (k >= options.min_iterations && solution.relative_error() <= options.relative_error))
      solution.reason = StopReason::kConverged;
    else if (options.relative_error > 0 && solution.bounded_error() <= rounding() / 2)
      solution.reason = StopReason::kIterationLimit;  // no iteration makes it better
    else if (k == options.max_iterations)
      solution.reason = StopReason::kIterationLimit;
    if (solution.reason != StopReason::kRunning) return solution;
    if (!ahead) go_on(k);
  }
}

template <class T>
auto SolidSolver<T>::set_pushed(const SurfacePatch& patch) -> Pushed {
  const Patch set = set_patch(patch.unknowns, true);
  const Eigen::Index n = set.count;
  if (patch.skin_m_n.size() != n || !(patch.skin_m_n.minCoeff() >= 0) || !patch.skin_m_n.allFinite())
    throw std::invalid_argument("patch: give each unknown a skin whose compliance is finite, 0 or more");
  Eigen::MatrixXd felt = row_->layered.among(patch.unknowns);
  felt.diagonal() += patch.skin_m_n;
  Pushed out{patch, set, Eigen::LLT<Eigen::MatrixXd>(felt), {}, {}};
  if (out.felt.info() != Eigen::Success)
    throw std::domain_error("patch: the compliance of the layered surface is not positive definite");
  const Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> inverse =
      out.felt.solve(Eigen::MatrixXd::Identity(n, n)).template cast<T>();
  queue_.write(inverse_, inverse.data(), static_cast<std::size_t>(inverse.size()));
  return out;
}

template <class T>
SolidSolution SolidSolver<T>::push(const SurfacePatch& patch, const Eigen::VectorXd& w,
                                   const SolidOptions& options) {
  std::optional<Pushed> last = std::exchange(pushed_, std::nullopt);
  const bool known = last && last->patch.unknowns == patch.unknowns && last->patch.skin_m_n == patch.skin_m_n;
  const bool from_last = options.from_last && known && last->force_n.size() > 0;
  Pushed now = known ? std::move(*last) : set_pushed(patch);
  const Patch& set = now.set;
  const Eigen::Index n = set.count;
  if (w.size() != n || !w.allFinite())
    throw std::invalid_argument("patch: give each unknown a finite displacement");
  if (!from_last) now.w = now.force_n = Eigen::VectorXd::Zero(n);
  const Eigen::VectorXd more = now.felt.solve(w - now.w), start = now.force_n + more;
  if (from_last)
    begin_from_last(set, more, start);
  else
    begin(set, start);
  SolidSolution solution = iterate(set, w.dot(start) - dot(u_[0], r_[0]), options);
  Eigen::Matrix<T, Eigen::Dynamic, 1> p(n);
  queue_.read(p_[last_p_], p.data(), static_cast<std::size_t>(n));
  solution.force_n = p.template cast<double>();
  solution.displacement_m = w - patch.skin_m_n.cwiseProduct(solution.force_n);
  now.w = w, now.force_n = solution.force_n;
  if (!solution.force_n.allFinite() || solution.reason == StopReason::kIndefinite ||
      !(solution.bounded_error() < 1))
    now.force_n.resize(0);
  if (options.from_last) pushed_ = std::move(now);
  return solution;
}

template <class T>
SolidSolution SolidSolver<T>::load(const std::vector<std::size_t>& unknowns, const Eigen::VectorXd& p,
                                   const SolidOptions& options) {
  pushed_.reset();
  const Patch set = set_patch(unknowns, false);
  if (p.size() != set.count || !p.allFinite())
    throw std::invalid_argument("patch: give each unknown a finite force");
  begin(set, p);
  const auto moved = [&]() -> Eigen::VectorXd { return row_of(u_[at(last_)])(unknowns); };
  SolidSolution solution = iterate(set, p.dot(moved()) + dot(u_[0], r_[0]), options);
  solution.force_n = p;
  solution.displacement_m = moved();
  return solution;
}

template <class T>
Eigen::VectorXd SolidSolver<T>::row_of(const Array<T>& field) const {
  Eigen::Matrix<T, Eigen::Dynamic, 1> row(static_cast<Eigen::Index>(3 * grid_.columns()));
  queue_.read(field, row.data(), 3 * grid_.columns(), row_begin());
  return row.template cast<double>();
}

template <class T>
RowExcess SolidSolver<T>::excess() {
  const bool surface = row_->index == 0;
  if (surface)
    preconditioner_.up(r_[at(last_)], {0, 3}, surface_);
  else
    solve_layers(r_[at(last_)], z_);
  RowExcess out{row_of(u_[at(last_)]), row_of(surface ? surface_ : z_)};
  move_layers({0, 3}, z_);
  out.moved_m += out.last_m - row_of(z_);
  if (!out.moved_m.allFinite() || !out.last_m.allFinite())
    throw std::domain_error("solid: the displacement of the touched nodes is not finite");
  return out;
}

template struct SolidModulus<float>;
template struct SolidModulus<double>;
template class SolidSolver<float>;
template class SolidSolver<double>;

}  // namespace teletact::service
