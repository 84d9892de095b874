#include "service/tissue/solid/solid_solver.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {
namespace {

// Scalars, as in kernels/solid.cl.
enum Scalar : std::size_t { kRho, kAlpha, kBeta, kCurvature, kScalars };

constexpr std::size_t kMaxChunks = 512;

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

// An upper bound of conjugate gradients' error, at every iteration, from the coefficients that they compute
// anyway: Gauss-Radau quadrature with a node at or below the smallest eigenvalue (Meurant and Tichy, On
// computing quadrature-based bounds for the A-norm of the error in conjugate gradients, Numer. Algorithms 62,
// 2013).
class RadauBound {
 public:
  // `min_eigenvalue`: at most the smallest one of M^-1 A, > 0.
  explicit RadauBound(double min_eigenvalue) : mu_(min_eigenvalue), gamma_(1 / min_eigenvalue) {}
  // After a step alpha from an iterate with r.z = rho to one with `next_rho`.
  void step(double alpha, double rho, double next_rho) {
    const double rest = gamma_ - alpha;
    // Rounding, or an eigenvalue below the one that was given: from here on it bounds nothing.
    if (!(rest >= 0)) holds_ = holds_ && rest >= -1e-12 * gamma_;
    gamma_ = rest > 0 ? rest / (mu_ * rest + next_rho / rho) : 0;
  }
  // Of the squared energy norm of the error of an iterate with r.z = rho.
  double squared(double rho) const { return gamma_ * rho; }
  bool holds() const { return holds_; }

 private:
  double mu_, gamma_;
  bool holds_ = true;
};

Range over(std::size_t groups, std::size_t nz, std::size_t planes) {
  return {{groups, nz, planes}, {std::min<std::size_t>(groups, 64), 1, 1}};
}

}  // namespace

double SolidSolution::bounded_error() const {
  const double energy = energy_j - energy_error_j;  // at least
  return energy > 0 ? std::sqrt(energy_error_j / energy) : energy_error_j > 0 ? HUGE_VAL : 0;
}

template <class T>
SolidModulus<T>::SolidModulus(const Queue& queue, const SolidTissue& tissue, LayeredTissue beside)
    : layers((validate(tissue), std::move(beside))), rounding(rounding_of<T>(tissue.poisson_ratio, layers)) {
  const SolidGrid& grid = tissue.grid;
  const std::size_t width = lanes(queue, grid.nx, sizeof(T)), nx = grid.nx;
  std::vector<T> wide((nx + 2 * width) * grid.nz * grid.layers());
  auto to = wide.begin();
  const auto append = [&to](auto begin, std::size_t count) {
    to = std::transform(begin, begin + static_cast<std::ptrdiff_t>(count), to,
                        [](double e) { return static_cast<T>(e); });
  };
  for (auto row = tissue.youngs_modulus_pa.begin(); row != tissue.youngs_modulus_pa.end();
       row += static_cast<std::ptrdiff_t>(nx)) {
    append(row + static_cast<std::ptrdiff_t>(nx - width), width);  // the period's copies on either side
    append(row, nx);
    append(row, width);
  }
  youngs_modulus_pa = queue.array(wide);
}

template <class T>
SolidSolver<T>::SolidSolver(const Queue& queue, const SolidTissue& tissue)
    : queue_(queue),
      grid_((validate(tissue), tissue.grid)),
      modulus_(std::make_shared<const SolidModulus<T>>(queue, tissue, layered(tissue))),
      preconditioner_(queue, grid_, modulus_->layers, tissue.poisson_ratio),
      row_(std::make_shared<const SolidRow>(SolidRow{0, preconditioner_.surface_compliance()})),
      width_(lanes(queue, grid_.nx, sizeof(T))),
      nx_(static_cast<int>(grid_.nx)),
      nz_(static_cast<int>(grid_.nz)),
      rows_(static_cast<int>(grid_.layers())),
      groups_(static_cast<int>(grid_.unknowns() / width_)),
      fields_(over(grid_.nx / width_, grid_.nz, 3 * grid_.layers())),
      elements_(over(grid_.nx / width_, grid_.nz, grid_.layers())) {
  const std::size_t layers = grid_.layers(), columns = grid_.columns(), unknowns = grid_.unknowns();
  const std::size_t groups = unknowns / width_, wide = grid_.nx + 2 * width_;
  chunk_ = (groups + kMaxChunks - 1) / kMaxChunks;
  chunks_ = (groups + chunk_ - 1) / chunk_;
  std::vector<T> stiffness;
  stiffness.reserve(576 * layers);
  for (std::size_t j = 0; j < layers; ++j) {
    const HexahedronMatrix k = hexahedron_stiffness(grid_.spacing_x_m, grid_.y_m[j + 1] - grid_.y_m[j],
                                                    grid_.spacing_z_m, tissue.poisson_ratio);
    for (int row = 0; row < 24; ++row)
      for (int column = 0; column < 24; ++column) stiffness.push_back(static_cast<T>(k(row, column)));
  }
  stiffness_ = queue.array(stiffness);
  for (Array<T>* field : {&u_, &r_, &z_, &kd_}) *field = queue.array<T>(unknowns);
  d_ = queue.array<T>(3 * (layers + 1) * grid_.nz * wide);
  surface_ = queue.array<T>(3 * columns);
  scalars_ = queue.array<T>(kScalars);
  partial_ = queue.array<T>(std::max(chunks_, layers * grid_.nz * (grid_.nx / width_)));
  slots_ = queue.array<int>(3 * columns);
  const Defines defines{{"WIDTH", std::to_string(width_)}};
  const auto get = [&](const char* name) { return queue.kernel("solid", name, precision_of<T>, defines); };
  apply_ = get("solid_apply");
  direction_ = get("solid_direction");
  dot_ = get("solid_dot");
  step_ = get("solid_step");
  subtract_ = get("solid_subtract");
  project_ = get("patch_project");
  spread_ = get("patch_spread");
  turn_ = get("patch_turn");
  patch_step_ = get("patch_step");
  queue_.fill_zero(d_);
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
    auto inverse = queue_.array<T>(4 * n * n);
    unknowns_ = std::move(unknowns), q_ = std::move(q), dq_ = std::move(dq), p_ = std::move(p);
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
    spread(p_, surface_, T{1}, components, 0);
    preconditioner_.solve_surface(surface_, components, u);
    return;
  }
  queue_.fill_zero(kd_);
  spread(p_, kd_, T{1}, {0, 3}, row_begin());
  solve_layers(kd_, u);
}

template <class T>
double SolidSolver<T>::dot(const Array<T>& a, const Array<T>& b) {
  dot_({{chunks_}, {1}}, a, b, partial_, groups_, static_cast<int>(chunk_));
  std::vector<T> sums(chunks_);
  queue_.read(partial_, sums.data(), chunks_);
  double sum = 0;
  for (const T s : sums) sum += static_cast<double>(s);
  return sum;
}

template <class T>
void SolidSolver<T>::multiply(const Array<T>& field) {
  direction_(fields_, scalars_, field, d_, nx_, nz_, 3 * rows_);
  apply_(elements_, stiffness_, modulus_->youngs_modulus_pa, d_, kd_, partial_, nx_, nz_, rows_);
}

template <class T>
void SolidSolver<T>::subtract(const Array<T>& a, const Array<T>& b, Array<T>& out) {
  subtract_({{static_cast<std::size_t>(groups_)}, {64}}, a, b, out, groups_);
}

template <class T>
void SolidSolver<T>::begin(const Patch& patch, const Eigen::VectorXd& force_n) {
  const Eigen::Matrix<T, Eigen::Dynamic, 1> force = force_n.cast<T>();
  queue_.write(p_, force.data(), static_cast<std::size_t>(patch.count));
  move_layers(patch.components, u_);
  const std::vector<T> none(kScalars, T{0});
  queue_.write(scalars_, none.data(), none.size());
  multiply(u_);
  queue_.fill_zero(z_);
  spread(p_, z_, T{1}, {0, 3}, row_begin());
  subtract(z_, kd_, r_);
}

template <class T>
void SolidSolver<T>::precondition(const Patch& patch) {
  if (!patch.pushed) return solve_layers(r_, z_);
  const auto project = [&](const Array<T>& field) {
    project_({{static_cast<std::size_t>(patch.count)}, {1}}, inverse_, unknowns_, field, q_, patch.count);
  };
  if (row_->index == 0) {
    preconditioner_.up(r_, patch.components, surface_);
    project(surface_);
    spread(q_, surface_, T{-1}, patch.components, 0);
    preconditioner_.down(surface_, patch.components, z_);
    return;
  }
  // No condition enters between the sweeps: q from z0, and the layers again, under r - B^T q.
  solve_layers(r_, z_);
  project(z_);
  queue_.fill_zero(z_);
  spread(q_, z_, T{1}, {0, 3}, row_begin());
  subtract(r_, z_, kd_);
  solve_layers(kd_, z_);
}

template <class T>
SolidSolution SolidSolver<T>::iterate(const Patch& patch, double twice_energy, const SolidOptions& options) {
  const int count = patch.pushed ? patch.count : 0;
  const auto partials = static_cast<int>(grid_.layers() * grid_.nz * (grid_.nx / width_));
  SolidSolution solution;
  RadauBound bound(layers().least);
  double rho = 0;
  for (std::size_t k = 0;; ++k) {
    precondition(patch);
    dot_({{chunks_}, {1}}, r_, z_, partial_, groups_, static_cast<int>(chunk_));
    turn_({{1}, {1}}, partial_, scalars_, q_, dq_, static_cast<int>(chunks_), count, k == 0 ? 1 : 0);
    std::array<T, kScalars> scalars;
    queue_.read(scalars_, scalars.data(), kScalars);
    const auto next = static_cast<double>(scalars[kRho]), alpha = static_cast<double>(scalars[kAlpha]);
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
    else if (rho == 0 || solution.relative_error() <= options.relative_error)
      solution.reason = StopReason::kConverged;
    else if (options.relative_error > 0 && solution.bounded_error() <= rounding() / 2)
      solution.reason = StopReason::kIterationLimit;  // no iteration makes it better
    else if (k == options.max_iterations)
      solution.reason = StopReason::kIterationLimit;
    if (solution.reason != StopReason::kRunning) return solution;
    multiply(z_);
    patch_step_({{1}, {1}}, partial_, scalars_, unknowns_, d_, kd_, p_, dq_, partials, count, nx_);
    step_(fields_, scalars_, d_, kd_, u_, r_, nx_, nz_, 3 * rows_);
  }
}

template <class T>
SolidSolution SolidSolver<T>::push(const SurfacePatch& patch, const Eigen::VectorXd& w,
                                   const SolidOptions& options) {
  const Patch set = set_patch(patch.unknowns, true);
  const Eigen::Index n = set.count;
  if (patch.skin_m_n.size() != n || !(patch.skin_m_n.minCoeff() >= 0) || !patch.skin_m_n.allFinite())
    throw std::invalid_argument("patch: give each unknown a skin whose compliance is finite, 0 or more");
  if (w.size() != n || !w.allFinite())
    throw std::invalid_argument("patch: give each unknown a finite displacement");
  Eigen::MatrixXd felt = row_->layered.among(patch.unknowns);
  felt.diagonal() += patch.skin_m_n;
  const Eigen::LLT<Eigen::MatrixXd> factor(felt);
  if (factor.info() != Eigen::Success)
    throw std::domain_error("patch: the compliance of the layered surface is not positive definite");
  const Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> inverse =
      factor.solve(Eigen::MatrixXd::Identity(n, n)).template cast<T>();
  queue_.write(inverse_, inverse.data(), static_cast<std::size_t>(inverse.size()));
  const Eigen::VectorXd start = factor.solve(w);
  begin(set, start);
  SolidSolution solution = iterate(set, w.dot(start) - dot(u_, r_), options);
  Eigen::Matrix<T, Eigen::Dynamic, 1> p(n);
  queue_.read(p_, p.data(), static_cast<std::size_t>(n));
  solution.force_n = p.template cast<double>();
  solution.displacement_m = w - patch.skin_m_n.cwiseProduct(solution.force_n);
  return solution;
}

template <class T>
SolidSolution SolidSolver<T>::load(const std::vector<std::size_t>& unknowns, const Eigen::VectorXd& p,
                                   const SolidOptions& options) {
  const Patch set = set_patch(unknowns, false);
  if (p.size() != set.count || !p.allFinite())
    throw std::invalid_argument("patch: give each unknown a finite force");
  begin(set, p);
  const auto moved = [&]() -> Eigen::VectorXd { return row_of(u_)(unknowns); };
  SolidSolution solution = iterate(set, p.dot(moved()) + dot(u_, r_), options);
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
    preconditioner_.up(r_, {0, 3}, surface_);
  else
    solve_layers(r_, z_);
  RowExcess out{row_of(u_), row_of(surface ? surface_ : z_)};
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
