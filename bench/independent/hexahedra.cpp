#include "bench/independent/hexahedra.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace teletact::bench {
namespace {

constexpr std::size_t kNodes = Hexahedra::kElementNodes;
using Matrix = Eigen::Matrix<double, 3 * kNodes, 3 * kNodes>;
using Shapes = Eigen::Matrix<double, kNodes, 1>;
using Gradients = Eigen::Matrix<double, kNodes, 3>;  // over the local coordinates

// Local coordinates, -1, 0 or 1: corners and middles of edges.
const std::array<Eigen::Vector3i, kNodes> kLocal = [] {
  std::array<Eigen::Vector3i, kNodes> local;
  std::size_t n = 0;
  for (int c = -1; c <= 1; ++c)
    for (int b = -1; b <= 1; ++b)
      for (int a = -1; a <= 1; ++a)
        if ((a == 0) + (b == 0) + (c == 0) <= 1) local[n++] = {a, b, c};
  return local;
}();

// A corner: (1 + x x_n)(1 + y y_n)(1 + z z_n)(x x_n + y y_n + z z_n - 2) / 8; a middle, of an edge along x:
// (1 - x^2)(1 + y y_n)(1 + z z_n) / 4.
void shapes_at(const Hexahedra::Point& p, Shapes& value, Gradients* gradient = nullptr) {
  for (std::size_t n = 0; n < kNodes; ++n) {
    const auto row = static_cast<Eigen::Index>(n);
    const Eigen::Vector3d local = kLocal[n].cast<double>();
    Eigen::Vector3d factor, slope;
    const bool corner = kLocal[n].cwiseAbs().sum() == 3;
    for (int axis = 0; axis < 3; ++axis) {
      const bool middle = kLocal[n][axis] == 0;
      factor[axis] = middle ? 1 - p[axis] * p[axis] : 1 + p[axis] * local[axis];
      slope[axis] = middle ? -2 * p[axis] : local[axis];
    }
    const double product = factor.prod(), last = corner ? (p.dot(local) - 2) / 8 : .25;
    value[row] = product * last;
    if (gradient == nullptr) continue;
    for (int axis = 0; axis < 3; ++axis)
      (*gradient)(row, axis) = slope[axis] * factor[(axis + 1) % 3] * factor[(axis + 2) % 3] * last +
                               (corner ? product * local[axis] / 8 : 0);
  }
}

// Of the eighth of a box that has the integration point `local`, for a modulus of 1.
Matrix stiffness_of(const Hexahedra::Point& size_m, const Hexahedra::Point& local, double poisson_ratio) {
  Shapes value;
  Gradients over;
  shapes_at(local, value, &over);
  for (int axis = 0; axis < 3; ++axis) over.col(axis) *= 2 / size_m[axis];
  const double lame = poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio)),
               shear = .5 / (1 + poisson_ratio), volume = size_m.prod() / 8;
  Matrix k;
  const Eigen::Matrix<double, kNodes, kNodes> grad_grad = over * over.transpose();
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) {
      Eigen::Matrix<double, kNodes, kNodes> block =
          lame * over.col(a) * over.col(b).transpose() + shear * over.col(b) * over.col(a).transpose();
      if (a == b) block += shear * grad_grad;
      for (Eigen::Index m = 0; m < block.rows(); ++m)
        for (Eigen::Index n = 0; n < block.cols(); ++n) k(3 * m + a, 3 * n + b) = volume * block(m, n);
    }
  return k;
}

}  // namespace

std::vector<double> graded_lines(const std::vector<double>& knots,
                                 const std::function<double(double)>& size_m) {
  constexpr std::size_t kSteps = 2000;
  std::vector<double> lines{knots.front()};
  for (std::size_t k = 0; k + 1 < knots.size(); ++k) {
    if (knots[k + 1] == knots[k]) continue;
    const double step = (knots[k + 1] - knots[k]) / kSteps;
    std::vector<double> count{0};  // of elements from the knot on
    for (std::size_t s = 0; s < kSteps; ++s)
      count.push_back(count.back() + step / size_m(knots[k] + step * (static_cast<double>(s) + .5)));
    const double elements = std::max(1., std::round(count.back()));
    for (double e = 1; e < elements; ++e) {
      const auto after = std::ranges::lower_bound(count, count.back() * e / elements);
      lines.push_back(knots[k] + step * static_cast<double>(after - count.begin()));
    }
    lines.push_back(knots[k + 1]);
  }
  return lines;
}

Hexahedra::Hexahedra(std::array<std::vector<double>, 3> lines) : lines_(std::move(lines)) {
  const auto& [x, y, z] = lines_;
  // By half steps: on lines, and halfway between two of one axis.
  const std::size_t ny = 2 * y.size() - 1, nz = 2 * z.size() - 1;
  std::vector<Eigen::Index> number((2 * x.size() - 1) * ny * nz, -1);
  const auto at = [](const std::vector<double>& of, std::size_t half) {
    return (of[half / 2] + of[(half + 1) / 2]) / 2;
  };
  for (std::size_t n = 0; n < number.size(); ++n) {
    const std::size_t i = n / nz / ny, j = n / nz % ny, k = n % nz;
    if (i % 2 + j % 2 + k % 2 > 1) continue;
    number[n] = size();
    nodes_.emplace_back(at(x, i), at(y, j), at(z, k));
  }
  for (std::size_t i = 0; i + 1 < x.size(); ++i)
    for (std::size_t j = 0; j + 1 < y.size(); ++j)
      for (std::size_t k = 0; k + 1 < z.size(); ++k) {
        Element& e = elements_.emplace_back();
        e.begin_m = {x[i], y[j], z[k]};
        e.size_m = Point(x[i + 1], y[j + 1], z[k + 1]) - e.begin_m;
        for (std::size_t n = 0; n < kNodes; ++n) {
          const auto half = (kLocal[n].array() + 1).cast<std::size_t>();
          e.nodes[n] = number[((2 * i + half[0]) * ny + 2 * j + half[1]) * nz + 2 * k + half[2]];
        }
      }
}

Hexahedra::Moduli Hexahedra::means(const std::function<double(const Point&)>& modulus_pa) const {
  constexpr int kSubdivisions = 4;  // of an eighth, along each axis
  Moduli moduli(elements_.size());
  for (std::size_t n = 0; n < moduli.size(); ++n)
    for (unsigned eighth = 0; eighth < 8; ++eighth) {
      const Point corner(eighth & 1, (eighth >> 1) & 1, eighth >> 2);
      double log_modulus = 0;
      for (int a = 0; a < kSubdivisions; ++a)
        for (int b = 0; b < kSubdivisions; ++b)
          for (int c = 0; c < kSubdivisions; ++c) {
            const Point inside = (Point(a, b, c).array() + .5) / kSubdivisions;
            log_modulus += std::log(
                modulus_pa(elements_[n].begin_m + elements_[n].size_m.cwiseProduct((corner + inside) / 2)));
          }
      moduli[n][eighth] = std::exp(log_modulus / std::pow(kSubdivisions, 3));
    }
  return moduli;
}

Hexahedra::Solution Hexahedra::solve(const Moduli& moduli_pa, double poisson_ratio,
                                     const Eigen::Matrix3Xd& prescribed_m) const {
  constexpr double kTolerance = 1e-6;
  const auto stiffness = [&](std::size_t element) {
    Matrix k = Matrix::Zero();
    for (unsigned eighth = 0; eighth < 8; ++eighth) {
      const Point corner(eighth & 1, (eighth >> 1) & 1, eighth >> 2);
      k += moduli_pa[element][eighth] *
           stiffness_of(elements_[element].size_m, (2 * corner.array() - 1) / std::sqrt(3), poisson_ratio);
    }
    return k;
  };

  const Eigen::Map<const Eigen::VectorXd> prescribed(prescribed_m.data(), prescribed_m.size());
  std::vector<int> unknown(static_cast<std::size_t>(prescribed.size()), -1);
  int unknowns = 0;
  for (std::size_t d = 0; d < unknown.size(); ++d)
    if (std::isnan(prescribed[static_cast<Eigen::Index>(d)])) unknown[d] = unknowns++;
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd right = Eigen::VectorXd::Zero(unknowns);
  for (std::size_t n = 0; n < elements_.size(); ++n) {
    const Element& e = elements_[n];
    const Matrix k = stiffness(n);
    for (Eigen::Index a = 0; a < k.rows(); ++a) {
      const int row = unknown[static_cast<std::size_t>(e.dof(a))];
      if (row < 0) continue;
      for (Eigen::Index b = 0; b < k.cols(); ++b) {
        const Eigen::Index from = e.dof(b);
        const int column = unknown[static_cast<std::size_t>(from)];
        if (column < 0)
          right[row] -= k(a, b) * prescribed[from];
        else if (column <= row)
          entries.emplace_back(row, column, k(a, b));
      }
    }
  }
  Eigen::SparseMatrix<double> matrix(unknowns, unknowns);
  matrix.setFromTriplets(entries.begin(), entries.end());
  entries = {};
  Eigen::ConjugateGradient<Eigen::SparseMatrix<double>, Eigen::Lower,
                           Eigen::IncompleteCholesky<double, Eigen::Lower, Eigen::NaturalOrdering<int>>>
      cg;
  cg.setTolerance(kTolerance);
  cg.setMaxIterations(5000);
  cg.compute(matrix);
  const Eigen::VectorXd free = cg.solve(right);
  if (cg.info() != Eigen::Success)
    throw std::runtime_error(
        fmt::format("finite elements: not converged after {} iterations, {:g}", cg.iterations(), cg.error()));

  Solution s{prescribed_m, Eigen::Matrix3Xd::Zero(3, prescribed_m.cols())};
  for (std::size_t d = 0; d < unknown.size(); ++d)
    if (unknown[d] >= 0) s.displacement_m.data()[d] = free[unknown[d]];
  for (std::size_t n = 0; n < elements_.size(); ++n) {
    const Element& e = elements_[n];
    Eigen::Vector<double, 3 * kNodes> moved;
    for (Eigen::Index a = 0; a < moved.size(); ++a) moved[a] = s.displacement_m.data()[e.dof(a)];
    moved = stiffness(n) * moved;
    for (Eigen::Index a = 0; a < moved.size(); ++a) s.force_n.data()[e.dof(a)] += moved[a];
  }
  return s;
}

Hexahedra::Point Hexahedra::at(const Point& point, const Eigen::Matrix3Xd& of_nodes) const {
  std::size_t element = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::vector<double>& l = lines_[axis];
    const auto after = std::upper_bound(l.begin() + 1, l.end() - 1, point[static_cast<int>(axis)]);
    element = element * (l.size() - 1) + static_cast<std::size_t>(after - l.begin()) - 1;
  }
  const Element& e = elements_[element];
  const Point local = 2 * (point - e.begin_m).cwiseQuotient(e.size_m) - Point::Ones();
  Shapes value;
  shapes_at(local.cwiseMax(-1).cwiseMin(1), value);
  Point sum = Point::Zero();
  for (std::size_t n = 0; n < kNodes; ++n)
    sum += value[static_cast<Eigen::Index>(n)] * of_nodes.col(e.nodes[n]);
  return sum;
}

}  // namespace teletact::bench
