#include "bench/peers/prescribed.h"

#include <algorithm>

#include "tests/reference/elasticity.h"

namespace teletact::bench {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

// Rows and columns `free` of k.
Eigen::SparseMatrix<double> part(const Eigen::SparseMatrix<double>& k, const std::vector<Index>& free) {
  std::vector<Index> unknown(static_cast<std::size_t>(k.rows()), -1);
  for (std::size_t n = 0; n < free.size(); ++n)
    unknown[static_cast<std::size_t>(free[n])] = static_cast<Index>(n);
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(static_cast<std::size_t>(k.nonZeros()));
  for (Index column = 0; column < k.outerSize(); ++column)
    for (Eigen::SparseMatrix<double>::InnerIterator it(k, column); it; ++it) {
      const Index a = unknown[static_cast<std::size_t>(it.row())];
      const Index b = unknown[static_cast<std::size_t>(it.col())];
      if (a >= 0 && b >= 0) entries.emplace_back(a, b, it.value());
    }
  const auto size = static_cast<Index>(free.size());
  Eigen::SparseMatrix<double> out(size, size);
  out.setFromTriplets(entries.begin(), entries.end());
  return out;
}

}  // namespace

PrescribedContact::PrescribedContact(const ContactProblem& p) {
  std::vector<bool> held(p.tissue.grid.dofs(), false);
  for (const std::size_t dof : reference::fixed_dofs(p.tissue.grid, p.tissue.supports)) held[dof] = true;
  for (const std::size_t dof : p.contact_dofs) held[dof] = true;
  for (std::size_t dof = 0; dof < held.size(); ++dof)
    if (!held[dof]) free.push_back(static_cast<Index>(dof));
  VectorXd pressed = VectorXd::Zero(p.stiffness.rows());
  for (Index r = 0; r < p.overlap_m.size(); ++r)
    pressed[static_cast<Index>(p.contact_dofs[static_cast<std::size_t>(r)])] = p.overlap_m[r];
  const VectorXd force = p.stiffness * pressed;
  right = -force(free);
  matrix = part(p.stiffness, free);
}

Eigen::SparseMatrix<double> PrescribedContact::uniform(const ContactProblem& p) const {
  service::Material material = p.tissue.material;
  std::fill(material.youngs_modulus_pa.begin(), material.youngs_modulus_pa.end(), 1e4);
  return part(reference::assemble(p.tissue.grid, material), free);
}

VectorXd PrescribedContact::displacement_m(const ContactProblem& p, const VectorXd& solution) const {
  VectorXd u = VectorXd::Zero(p.stiffness.rows());
  u(free) = solution;
  for (Index r = 0; r < p.overlap_m.size(); ++r)
    u[static_cast<Index>(p.contact_dofs[static_cast<std::size_t>(r)])] = p.overlap_m[r];
  return u;
}

std::array<double, 2> PrescribedContact::force_n(const ContactProblem& p, const VectorXd& u) {
  VectorXd multiplier(p.overlap_m.size());
  for (Index r = 0; r < multiplier.size(); ++r)  // K is symmetric: its column is its row
    multiplier[r] = -p.stiffness.col(static_cast<Index>(p.contact_dofs[static_cast<std::size_t>(r)])).dot(u);
  return p.force_n(multiplier);
}

}  // namespace teletact::bench
