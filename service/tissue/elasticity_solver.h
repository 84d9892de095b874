// K u = f on a tissue grid by multigrid-preconditioned conjugate gradients on a device (T4): for whatever
// does not go through the condensed compliance.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "service/device/device.h"
#include "service/tissue/compliance.h"
#include "service/tissue/elasticity.h"

namespace teletact::service {

// kRefined: float inside, residuals in double (on the host where the device has none): the accuracy of
// kDouble.
enum class SolvePrecision { kFloat, kDouble, kRefined };

struct ElasticitySolverOptions {
  SolvePrecision precision = SolvePrecision::kRefined;
  // Energy norm of the error relative to that of the solution; 0 = 1e-7, for kFloat 6e-4. Forces and
  // compliances are at least as good: |C_ij error| <= relative_error sqrt(C_ii C_jj).
  double relative_error = 0;
  std::size_t max_iterations = 500;  // of one conjugate gradient run
  // [dof], 1 where the displacement is prescribed, besides the supports; empty = nowhere, as the service has
  // it. With the nodes in contact prescribed the contact chart compares one solve with other methods' (T6.2).
  std::vector<std::uint8_t> prescribed;
  MemoryAccount account = {};  // of the device's arrays
};

// Other units, in which the same tissue is computed again for a sample of what rounding does to an answer:
// lengths and moduli times these. No powers of two, which would round alike.
struct Units {
  double length = 1, modulus = 1;
};
constexpr Units kOtherUnits[] = {{1.1, 3}, {1.3, 5}, {1.7, 7}, {1.9, 11}, {2.3, 13}, {2.9, 17}};

class ElasticityCorrection;

// One thread at a time; it has a queue of its own. Solves are done in batches of 32 right-hand sides.
class ElasticitySolver {
 public:
  // Throws std::invalid_argument (field named) for an unusable grid, material or options, and when nothing at
  // all is held; DeviceError when the device cannot do what is asked.
  ElasticitySolver(const std::shared_ptr<Device>&, TissueGrid, const Supports&, Material,
                   ElasticitySolverOptions = {});
  ~ElasticitySolver();
  // The queue that it works on: its profile, where the device was opened with profiling.
  const Queue& queue() const { return queue_; }
  // Of the preconditioned operator, the least that a solve has found: above 0, at most 1; 0 before the first
  // solve.
  double smallest_eigenvalue() const { return smallest_eigenvalue_; }
  // Solves for `count` right-hand sides.
  //   loads: [count][dof] nodal forces per metre of thickness (N/m); empty = none
  //   displacement: [count][dof] (m), in: what is prescribed where `options.prescribed` says so, elsewhere
  //   the initial guess (zeros if unknown), out: the solution, zero on supports
  // The report holds the worst column: relative_error bounds ||error|| / ||solution|| in the energy norm with
  // the rounding of the precision used, and is infinite where a run broke down; converged is false, and
  // reason says why, when the tolerance was not reached. Throws std::invalid_argument for sizes that do not
  // fit or values that are not finite.
  SolveReport solve(std::size_t count, std::span<const double> loads, std::span<double> displacement);
  // K u for all unknowns, [count][dof] (N/m): where a displacement is prescribed or supported, this less the
  // load there is the reaction, the force that holds it.
  std::vector<double> nodal_forces(std::size_t count, std::span<const double> displacement);
  // The same in other units, and back in N/m: rounded differently, so that the difference is a sample of the
  // rounding error.
  std::vector<double> nodal_forces_in(const Units&, std::size_t count, std::span<const double> displacement);
  // About K^-1 r, by one application of the preconditioner: [count][dof] (m) of residuals r (N/m), which are
  // taken as zero where nothing is free.
  std::vector<double> preconditioned(std::size_t count, std::span<const double> residual);

 private:
  struct Column;
  using Vectors = std::span<const double>;  // [vector][dof]
  std::size_t dofs() const { return tissue_.grid.dofs(); }
  Vectors part(Vectors v, std::size_t begin, std::size_t count) const {
    return v.empty() ? v : v.subspan(begin * dofs(), count * dofs());
  }
  void reserve(std::size_t count);
  void check(std::size_t count, Vectors loads, Vectors displacement) const;
  std::vector<double> forces(Vectors displacement);
  std::vector<double> forces_in(const Units&, Vectors displacement);
  std::vector<double> masked(Vectors) const;
  std::vector<double> right_hand_norms(const std::vector<double>& load, Vectors u,
                                       const std::vector<double>& force);
  void refresh(Vectors load, Vectors u, const std::vector<double>& force, std::vector<double>& residual,
               std::vector<Column>& columns);
  void run(bool first, const std::vector<double>& load, std::span<double> u, std::vector<double>& residual,
           std::vector<Column>& columns);
  std::vector<double> error_bounds(std::size_t count, Vectors residual);
  std::vector<Column> solve_batch(std::size_t count, Vectors loads, std::span<double> u);
  SolveReport report(const std::vector<Column>&) const;
  // What `work` makes of vectors, so many at a time as there is room for.
  std::vector<double> in_batches(std::size_t count, Vectors,
                                 const std::function<std::vector<double>(Vectors)>& work);

  ElasticitySolverOptions options_;
  Queue queue_;
  ScaledTissue tissue_;
  double smallest_eigenvalue_ = 0;  // of M K, the least seen
  std::size_t capacity_ = 0;
  std::unique_ptr<Elasticity<double>> exact_;                             // none on a device without double
  std::map<double, std::unique_ptr<Elasticity<double>>> in_other_units_;  // by Units::modulus
  Array<double> exact_u_, exact_f_;
  std::unique_ptr<ElasticityCorrection> correction_;
};

}  // namespace teletact::service
