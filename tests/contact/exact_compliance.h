// The compliance of a surface computed in long double, element matrices included: what answers in double are
// judged by.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCholesky>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "service/tissue/compliance.h"
#include "service/tissue/grid.h"

namespace teletact::tests {

using Real = long double;

// Strain [eps_xx, eps_yy, gamma_xy] of the eight displacements at (s, t) in [0, 1]^2.
inline Eigen::Matrix<Real, 3, 8> exact_strain(Real s, Real t, Real width, Real height) {
  const std::array<Real, 4> gx{-(1 - t) / width, (1 - t) / width, -t / width, t / width};
  const std::array<Real, 4> gy{-(1 - s) / height, -s / height, (1 - s) / height, s / height};
  Eigen::Matrix<Real, 3, 8> b = Eigen::Matrix<Real, 3, 8>::Zero();
  for (Eigen::Index a = 0; a < 4; ++a) {
    b(0, 2 * a) = b(2, 2 * a + 1) = gx[std::size_t(a)];
    b(1, 2 * a + 1) = b(2, 2 * a) = gy[std::size_t(a)];
  }
  return b;
}

// Its parts: shear, and bulk volume volume^T, which near nu = 1/2 must be kept apart to be exact.
struct ExactElement {
  Eigen::Matrix<Real, 8, 8> shear;
  Eigen::Matrix<Real, 8, 1> volume;
  std::array<Eigen::Index, 8> dofs;
  Eigen::Matrix<Real, 8, 8> stiffness() const { return shear + volume * volume.transpose(); }
  Eigen::Matrix<Real, 8, 1> force(const Eigen::Matrix<Real, 8, 1>& u) const {
    return shear * u + volume * volume.dot(u);
  }
};

inline ExactElement exact_element(Real width, Real height, Real e, Real nu) {
  const Real mu = e / (2 * (1 + nu)), lambda = e * nu / ((1 + nu) * (1 - 2 * nu)), half = Real(1) / 2;
  const Eigen::Matrix<Real, 3, 1> shear(2 * mu, 2 * mu, mu), trace(1, 1, 0);
  const Real at = std::sqrt(Real(1) / 12), area = width * height;
  ExactElement part;
  part.shear.setZero();
  for (const Real s : {half - at, half + at})
    for (const Real t : {half - at, half + at}) {
      const auto b = exact_strain(s, t, width, height);
      part.shear += area / 4 * b.transpose() * shear.asDiagonal() * b;
    }
  const auto b = exact_strain(half, half, width, height);
  part.volume = std::sqrt(area * lambda) * b.transpose() * trace;
  return part;
}

// Of the surface, bottom fixed.
class ExactCompliance final : public service::Compliance {
 public:
  ExactCompliance(const service::TissueGrid& grid, const service::Material& material) {
    const Eigen::Index free = Eigen::Index(2 * grid.nx() * (grid.ny() - 1)),
                       size = Eigen::Index(2 * grid.nx());
    std::vector<Eigen::Triplet<Real>> entries;
    for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
      for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
        ExactElement part =
            exact_element(Real(grid.x_m[i + 1]) - grid.x_m[i], Real(grid.y_m[j + 1]) - grid.y_m[j],
                          material.youngs_modulus_pa[grid.element(i, j)], material.poisson_ratio);
        const Eigen::Matrix<Real, 8, 8> k = part.stiffness();
        const std::array nodes{grid.node(i, j), grid.node(i + 1, j), grid.node(i, j + 1),
                               grid.node(i + 1, j + 1)};
        std::array<Eigen::Index, 8>& dofs = part.dofs;
        for (std::size_t a = 0; a < 8; ++a) dofs[a] = Eigen::Index(2 * nodes[a / 2] + a % 2);
        for (Eigen::Index a = 0; a < 8; ++a)
          for (Eigen::Index b = 0; b < 8; ++b)
            if (dofs[std::size_t(a)] < free && dofs[std::size_t(b)] < free)
              entries.emplace_back(dofs[std::size_t(a)], dofs[std::size_t(b)], k(a, b));
        elements_.push_back(part);
      }
    Eigen::SparseMatrix<Real> k(free, free);
    k.setFromTriplets(entries.begin(), entries.end());
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<Real>> factor(k);
    s_.resize(size, size);
    for (Eigen::Index q = 0; q < size; ++q) {
      const Eigen::Matrix<Real, Eigen::Dynamic, 1> f = Eigen::Matrix<Real, Eigen::Dynamic, 1>::Unit(free, q);
      Eigen::Matrix<Real, Eigen::Dynamic, 1> u = factor.solve(f);
      for (int pass = 0; pass < 3; ++pass) u += factor.solve(f - forces(u));  // the factor's rounding is felt
      s_.col(q) = u.head(size).cast<double>();
    }
  }
  Eigen::MatrixXd among(std::span<const std::size_t> nodes, service::SolveReport*) override {
    std::vector<Eigen::Index> at;
    for (const std::size_t node : nodes)
      at.insert(at.end(), {Eigen::Index(2 * node), Eigen::Index(2 * node + 1)});
    return s_(at, at);
  }
  Eigen::MatrixXd axial_among(std::span<const std::size_t> nodes, service::SolveReport*) override {
    std::vector<Eigen::Index> at;
    for (const std::size_t node : nodes) at.push_back(Eigen::Index(2 * node + 1));
    return s_(at, at);
  }

 private:
  // K u of the free unknowns, from differences of displacement within each element.
  Eigen::Matrix<Real, Eigen::Dynamic, 1> forces(const Eigen::Matrix<Real, Eigen::Dynamic, 1>& u) const {
    Eigen::Matrix<Real, Eigen::Dynamic, 1> f = Eigen::Matrix<Real, Eigen::Dynamic, 1>::Zero(u.size());
    for (const ExactElement& part : elements_) {
      const auto of = [&](std::size_t a) { return part.dofs[a] < u.size() ? u[part.dofs[a]] : 0; };
      Eigen::Matrix<Real, 8, 1> local;
      for (std::size_t a = 0; a < 8; ++a) local[Eigen::Index(a)] = of(a) - of(a % 2);
      const auto force = part.force(local);
      for (std::size_t a = 0; a < 8; ++a)
        if (part.dofs[a] < u.size()) f[part.dofs[a]] += force[Eigen::Index(a)];
    }
    return f;
  }

  std::vector<ExactElement> elements_;
  Eigen::MatrixXd s_;
};

}  // namespace teletact::tests
