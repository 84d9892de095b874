// One run of conjugate gradients for ElasticitySolver: a residual in double goes in, a correction in double
// comes out, the work is done in T on numbers scaled to its range. Private to service/tissue.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "service/solver/pcg.h"
#include "service/tissue/elasticity.h"

namespace teletact::service {

class ElasticityCorrection {
 public:
  virtual ~ElasticityCorrection() = default;
  // Room for so many right-hand sides at once. All or nothing.
  virtual void reserve(std::size_t count) = 0;
  // What a run needs of each right-hand side, [count][dof] or [count]; loads and residuals (N/m) vanish on
  // constrained unknowns.
  struct Problem {
    std::size_t count = 0;
    std::span<const double> residual, load;
    std::vector<double> initial_energy, absolute_error;  // J/m and its square root, see Pcg
    double relative_error = 0;
  };
  // Solves K x = residual. correction: x (m), out. Energies in the results are in J/m, residual norms in N/m.
  virtual std::vector<PcgResult> solve(const Problem&, std::span<double> correction) = 0;
  // Residuals that the last solve's recurrence left (N/m), out.
  virtual void recursive_residuals(std::span<double>) = 0;
  // (r . M r)^(1/2) of residuals r (N/m): with the smallest eigenvalue of M K, a bound of ||K^-1 r||_K.
  // Infinite where r . M r is not positive, nor M then: nothing is bounded.
  virtual std::vector<double> norm(std::size_t count, std::span<const double> residual) = 0;
  // M r (m).
  virtual std::vector<double> preconditioned(std::size_t count, std::span<const double> residual) = 0;
};

// Refers to the tissue. Has no room yet.
std::unique_ptr<ElasticityCorrection> make_elasticity_correction(Precision, const Queue&, const ScaledTissue&,
                                                                 const PcgOptions&);

}  // namespace teletact::service
