#include "service/imaging/modulus/direct_equation.h"

#include <sys/mman.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <utility>

#include "service/device/cancellation.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Matrix8 = Eigen::Matrix<double, 8, 8>;
using Rows = Eigen::Matrix<double, 2, 8>;

// Its pages at once. Left to the allocator, those of all blocks go together when the last one does, which
// takes 0.2 s for the 2 GB at the limits.
void give_back(Eigen::MatrixXd& block) {
  constexpr std::uintptr_t kPage = 4096, kLarge = 16 * kPage;
  const auto begin = reinterpret_cast<std::uintptr_t>(block.data());
  const std::uintptr_t end = begin + sizeof(double) * static_cast<std::uintptr_t>(block.size());
  const std::uintptr_t first = (begin + kPage - 1) / kPage * kPage, last = end / kPage * kPage;
  if (end - begin >= kLarge) madvise(reinterpret_cast<void*>(first), last - first, MADV_DONTNEED);
  block.resize(0, 0);
}

double median_magnitude(std::vector<double> values) {
  for (double& v : values) v = std::abs(v);
  return median(values);
}

// One element of dx x dy: rows of unknowns 2 a (pressure) and 2 a + 1 (shear modulus) of its node a.
class Element {
 public:
  Element(double dx_m, double dy_m) {
    const double near = 0.5 - 0.5 / std::sqrt(3.0);
    for (int g = 0; g < 4; ++g) {
      const double s = g % 2 ? 1 - near : near, t = g / 2 ? 1 - near : near;
      shape_[g] = {(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t};
      slope_x_[g] = {-(1 - t), 1 - t, -t, t};
      slope_y_[g] = {-(1 - s), -s, 1 - s, s};
      for (int a = 0; a < 4; ++a) slope_x_[g][a] /= dx_m, slope_y_[g][a] /= dy_m;
    }
  }
  // xx, yy, xy: A_mu / 2 at the four nodes over its scale.
  Matrix8 matrix(const std::array<double, 4>& xx, const std::array<double, 4>& yy,
                 const std::array<double, 4>& xy, double stabilisation) const {
    Matrix8 k = Matrix8::Zero();
    for (std::size_t g = 0; g < 4; ++g) {
      double x = 0, y = 0, s = 0;
      for (std::size_t a = 0; a < 4; ++a)
        x += shape_[g][a] * xx[a], y += shape_[g][a] * yy[a], s += shape_[g][a] * xy[a];
      Rows test, trial;
      for (std::size_t a = 0; a < 4; ++a) {
        const double nx = slope_x_[g][a], ny = slope_y_[g][a];
        const auto p = static_cast<Eigen::Index>(2 * a);
        test.col(p) = trial.col(p) = Eigen::Vector2d(-nx, -ny);
        test.col(p + 1) = Eigen::Vector2d(x * nx + s * ny, s * nx + y * ny);
        trial.col(p + 1) = Eigen::Vector2d(xx[a] * nx + xy[a] * ny, xy[a] * nx + yy[a] * ny);
      }
      k.noalias() += test.transpose() * trial;
      for (std::size_t a = 0; a < 4; ++a)
        for (std::size_t b = 0; b < 4; ++b)
          k(static_cast<Eigen::Index>(2 * a + 1), static_cast<Eigen::Index>(2 * b + 1)) +=
              stabilisation * (slope_x_[g][a] * slope_x_[g][b] + slope_y_[g][a] * slope_y_[g][b]);
    }
    return k;
  }

 private:
  std::array<std::array<double, 4>, 4> shape_, slope_x_, slope_y_;  // [Gauss point][node]
};

// The unknowns of the interior, column of nodes after column: block i - 1, `per_node` per node from the top.
class System {
 public:
  System(const WindowNodes& nodes, const DirectProblem& problem, double scale)
      : nodes_(nodes),
        problem_(problem),
        scale_(scale),
        per_node_(problem.plane == Plane::kStrain ? 2 : 1),
        size_(static_cast<Eigen::Index>(per_node_ * (nodes.ny - 2))),
        blocks_(static_cast<Eigen::Index>(nodes.nx - 2), size_),
        load_(Eigen::MatrixXd::Zero(size_, static_cast<Eigen::Index>(nodes.nx - 2))) {
    const Element element(nodes.dx_m, nodes.dy_m);
    for (std::size_t i = 0; i + 1 < nodes.nx; ++i) {
      check_cancelled();
      for (std::size_t j = 0; j + 1 < nodes.ny; ++j) {
        const std::size_t n = i + nodes.nx * j;
        const std::array<std::size_t, 4> at{n, n + 1, n + nodes.nx, n + nodes.nx + 1};
        const auto of = [&](const std::vector<double>& field) {
          return std::array<double, 4>{field[at[0]] / scale, field[at[1]] / scale, field[at[2]] / scale,
                                       field[at[3]] / scale};
        };
        add(at, element.matrix(of(problem.xx), of(problem.yy), of(problem.xy), problem.stabilisation));
      }
    }
  }

  DirectSolution solve() {
    const BlockTridiagonal::Solution x = blocks_.solve(load_);
    DirectSolution out{problem_.shear_modulus,
                       per_node_ == 2 ? problem_.half_pressure : std::vector<double>{}, x.residual};
    for (std::size_t n = 0; n < nodes_.size(); ++n) {
      if (on_border(n)) continue;
      const Eigen::Index row = row_of(n), column = column_of(n);
      out.shear_modulus[n] = x.x(row + static_cast<Eigen::Index>(per_node_) - 1, column);
      if (per_node_ == 2) out.half_pressure[n] = x.x(row, column) * scale_;
    }
    return out;
  }

 private:
  bool on_border(std::size_t n) const {
    const std::size_t i = n % nodes_.nx, j = n / nodes_.nx;
    return i == 0 || j == 0 || i + 1 == nodes_.nx || j + 1 == nodes_.ny;
  }
  Eigen::Index row_of(std::size_t n) const {
    return static_cast<Eigen::Index>(per_node_ * (n / nodes_.nx - 1));
  }
  Eigen::Index column_of(std::size_t n) const { return static_cast<Eigen::Index>(n % nodes_.nx - 1); }

  void add(const std::array<std::size_t, 4>& at, const Matrix8& k) {
    const std::size_t first = 2 - per_node_;  // plane stress has no pressure
    for (std::size_t a = 0; a < 4; ++a) {
      if (on_border(at[a])) continue;
      for (std::size_t b = 0; b < 4; ++b)
        for (std::size_t c = first; c < 2; ++c)
          for (std::size_t d = first; d < 2; ++d)
            put(at[a], c - first, at[b], d,
                k(static_cast<Eigen::Index>(2 * a + c), static_cast<Eigen::Index>(2 * b + d)));
    }
  }
  void put(std::size_t row_node, std::size_t row_kind, std::size_t node, std::size_t kind, double value) {
    const Eigen::Index row = row_of(row_node) + static_cast<Eigen::Index>(row_kind),
                       own = column_of(row_node);
    if (on_border(node)) {
      load_(row, own) -=
          value * (kind == 1 ? problem_.shear_modulus[node] : problem_.half_pressure[node] / scale_);
      return;
    }
    const Eigen::Index other = column_of(node);
    auto& block = other < own ? blocks_.lower : other > own ? blocks_.upper : blocks_.diagonal;
    block[static_cast<std::size_t>(own)](
        row, row_of(node) + static_cast<Eigen::Index>(kind + per_node_) - 2) += value;
  }

  const WindowNodes& nodes_;
  const DirectProblem& problem_;
  double scale_;
  std::size_t per_node_;
  Eigen::Index size_;
  BlockTridiagonal blocks_;
  Eigen::MatrixXd load_;
};

}  // namespace

BlockTridiagonal::BlockTridiagonal(Eigen::Index count, Eigen::Index size) {
  for (Eigen::Index k = 0; k < count; ++k) {
    check_cancelled();  // at the limits these are 2 GB
    for (auto* blocks : {&diagonal, &lower, &upper}) blocks->push_back(Eigen::MatrixXd::Zero(size, size));
  }
}

// D_0 = diagonal_0, D_k = diagonal_k - lower_k D_(k-1)^-1 upper_(k-1); then backwards.
BlockTridiagonal::Solution BlockTridiagonal::solve(const Eigen::MatrixXd& b) {
  const std::size_t count = diagonal.size();
  std::vector<Eigen::MatrixXd> carry(count);  // D_k^-1 upper_k
  Eigen::MatrixXd y = b;
  Eigen::MatrixXd d = diagonal[0];
  for (std::size_t k = 0; k < count; ++k) {
    check_cancelled();
    const auto column = static_cast<Eigen::Index>(k);
    const Eigen::PartialPivLU<Eigen::MatrixXd> lu(d);
    y.col(column) = lu.solve(y.col(column)).eval();
    if (!y.col(column).allFinite()) throw std::domain_error("a block of the system is singular");
    if (k + 1 == count) break;
    check_cancelled();
    carry[k] = lu.solve(upper[k]);
    check_cancelled();
    d = diagonal[k + 1];
    d.noalias() -= lower[k + 1] * carry[k];
    y.col(column + 1).noalias() -= lower[k + 1] * y.col(column);
  }
  for (std::size_t k = count - 1; k-- > 0;) {
    check_cancelled();
    y.col(static_cast<Eigen::Index>(k)).noalias() -= carry[k] * y.col(static_cast<Eigen::Index>(k) + 1);
    give_back(carry[k]);
  }
  Solution out{std::move(y), 0};
  Eigen::MatrixXd residual = b;
  for (std::size_t k = 0; k < count; ++k) {
    check_cancelled();
    const auto column = static_cast<Eigen::Index>(k);
    residual.col(column) -= diagonal[k] * out.x.col(column);
    if (k > 0) residual.col(column) -= lower[k] * out.x.col(column - 1);
    if (k + 1 < count) residual.col(column) -= upper[k] * out.x.col(column + 1);
    for (auto* blocks : {&diagonal, &lower, &upper}) give_back((*blocks)[k]);
  }
  if (b.norm() > 0) out.residual = residual.norm() / b.norm();
  return out;
}

DirectSolution solve_direct(const WindowNodes& nodes, const DirectProblem& problem) {
  if (nodes.nx < 3 || nodes.ny < 3) throw std::invalid_argument("the window must be 3 x 3 nodes or more");
  const double scale = median_magnitude(problem.yy);
  if (!(scale > 0)) throw std::domain_error("the strain is zero");
  return System(nodes, problem, scale).solve();
}

}  // namespace teletact::service
