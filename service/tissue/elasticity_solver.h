// K u = f on a tissue grid by multigrid-preconditioned conjugate gradients on a device (T4): for whatever
// does not go through the condensed compliance.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "service/device/device.h"
#include "service/tissue/compliance.h"
#include "service/tissue/grid.h"

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

// One thread at a time; it has a queue of its own. Solves are done in batches of 32 right-hand sides.
class ElasticitySolver {
 public:
  // Throws std::invalid_argument (field named) for an unusable grid or options, and when nothing at all is
  // held; DeviceError when the device cannot do what is asked.
  ElasticitySolver(const std::shared_ptr<Device>&, TissueGrid, Supports, ElasticitySolverOptions = {});
  ~ElasticitySolver();
  // Before the first solve, and again for another material. Throws std::invalid_argument (field named).
  void set_material(const Material&);
  // The queue that it works on: its profile, where the device was opened with profiling.
  const Queue& queue() const;
  // Of the preconditioned operator, the least that a solve with this material has found: above 0, at most 1;
  // 0 before the first solve.
  double smallest_eigenvalue() const;
  // [dof]: 0 where the displacement is prescribed or supported.
  const std::vector<std::uint8_t>& free() const;
  // Solves for `count` right-hand sides.
  //   loads: [count][dof] nodal forces per metre of thickness (N/m); empty = none
  //   prescribed: [count][dof] displacements (m), read where `options.prescribed` says so; empty = zero
  //   displacement: [count][dof] (m), in: initial guess (zeros if unknown), out: the solution
  // The report holds the worst column: relative_error bounds ||error|| / ||solution|| in the energy norm with
  // the rounding of the precision used, and is infinite where a run broke down; converged is false, and
  // reason says why, when the tolerance was not reached. Throws std::invalid_argument for sizes that do not
  // fit or values that are not finite.
  SolveReport solve(std::size_t count, std::span<const double> loads, std::span<const double> prescribed,
                    std::span<double> displacement);
  // K u for all unknowns, [count][dof] (N/m): where a displacement is prescribed or supported, this less the
  // load there is the reaction, the force that holds it.
  std::vector<double> nodal_forces(std::size_t count, std::span<const double> displacement);
  // The same in other units of length and modulus, `which` < kOtherUnits, and back in N/m: rounded
  // differently, so that the difference is a sample of the rounding error.
  std::vector<double> nodal_forces_in_units(std::size_t which, std::size_t count,
                                            std::span<const double> displacement);
  // About K^-1 r, by one application of the preconditioner: [count][dof] (m) of residuals r (N/m), which are
  // taken as zero where nothing is free.
  std::vector<double> preconditioned(std::size_t count, std::span<const double> residual);

 private:
  struct Core;
  std::unique_ptr<Core> core_;
};

}  // namespace teletact::service
