#include "service/imaging/modulus/direct_equation.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/block_tridiagonal.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Matrix8 = Eigen::Matrix<double, 8, 8>;
using Rows = Eigen::Matrix<double, 2, 8>;

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

DirectSolution solve_direct(const WindowNodes& nodes, const DirectProblem& problem) {
  if (nodes.nx < 3 || nodes.ny < 3) throw std::invalid_argument("the window must be 3 x 3 nodes or more");
  const double scale = median_magnitude(problem.yy);
  if (!(scale > 0)) throw std::domain_error("the strain is zero");
  return System(nodes, problem, scale).solve();
}

}  // namespace teletact::service
