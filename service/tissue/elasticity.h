// Plane-strain elasticity on a tissue grid as the solver sees it (T4; kernels/elasticity.cl): the matrix-free
// operator and its stencil, on a device; and the same product on the host in double.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "service/solver/linear_operator.h"
#include "service/tissue/grid.h"

namespace teletact::service {

// Lame's constants of a unit modulus: mu = E mu_per_e, lambda = E lambda_per_e.
struct LameRatios {
  double mu_per_e = 0, lambda_per_e = 0;
};
LameRatios lame_ratios(double poisson_ratio);

// [node][2]: 1 where an unknown is free, 0 where an edge holds it.
std::vector<std::uint8_t> free_unknowns(const TissueGrid&, const Supports&);

// y = K x for `count` displacements [vector][dof] (m), all unknowns free: nodal forces per metre of thickness
// (N/m). On the host, in double; for devices without it. All lengths of the grid count times `length`, which
// changes nothing but how it is rounded: a stiffness in plane strain depends on ratios of lengths alone.
void apply_on_host(const TissueGrid&, const Material&, std::size_t count, std::span<const double> x,
                   std::span<double> y, double length = 1);

// What is solved. K is computed for the moduli over reference_pa, to stay within the range of float.
struct ScaledTissue {
  TissueGrid grid;
  Material material;
  double reference_pa = 1;
  std::vector<std::uint8_t> free;  // [node][2]: 1, or 0 where an unknown is held
};

// [9][ny][nx] blocks of 4 (kernels/stencil.clh), held unknowns as the identity. On the host, in double.
std::vector<double> stencil_on_host(const ScaledTissue&);

template <class T>
class Elasticity : public LinearOperator<T> {
 public:
  // `length`: as above.
  Elasticity(const Queue&, const ScaledTissue&, double length = 1);
  // Constrained unknowns as the identity; x must vanish there, as conjugate gradients' vectors do.
  void apply(const Array<T>& x, Array<T>& y, std::size_t count) override;
  // y = K x for all unknowns.
  void apply_unconstrained(const Array<T>& x, Array<T>& y, std::size_t count);
  // [9][ny][nx] blocks of 4 (kernels/stencil.clh), constrained unknowns as the identity.
  Array<T> stencil();

 private:
  Kernel kernel(const char* name) const;
  void launch(const Array<T>& x, Array<T>& y, std::size_t count, int constrain);
  Queue queue_;
  std::size_t nx_, ny_;
  T mu_per_e_, lambda_per_e_;
  Array<T> modulus_, width_, height_, free_;
  std::size_t at_once_;  // nodes of a work item (kernels/wide.clh)
  Kernel apply_, stencil_;
};

}  // namespace teletact::service
