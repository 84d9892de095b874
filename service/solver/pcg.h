// Preconditioned conjugate gradients for many right-hand sides at once on a device. All scalars stay there,
// the decision to stop too; the host only looks now and then whether any right-hand side still runs.
//
// Solves A x = r from x = 0: the caller forms the residual r of its initial guess in the precision it wants
// and adds the correction x (see ElasticitySolver for restarts in double around a float Pcg).
//
// Stopping: near nu = 1/2 a small residual is no small error, so what is bounded is the energy norm of the
// error, ||e||_A, estimated from the terms alpha_k r_k.z_k with a delay (Hestenes and Stiefel 1952; Strakos
// and Tichy 2002), relative to that of the whole solution u = guess + x,
//   ||u||_A^2 = ||guess||_A^2 + 2 load.x - ||x||_A^2.
#pragma once

#include <cstdint>
#include <vector>

#include "service/solver/linear_operator.h"

namespace teletact::service {

enum class StopReason { kRunning, kConverged, kIterationLimit, kIndefinite, kNotFinite };
const char* to_string(StopReason);

constexpr std::size_t kDelay = 2;  // iterations that the error estimate looks back; it needs twice as many

struct PcgOptions {
  double relative_error = 1e-7;      // ||e||_A / ||u||_A to reach; 0 = not a criterion
  double relative_residual = 0;      // ||r|| / ||r_0|| to reach instead; 0 = not a criterion
  std::size_t max_iterations = 500;  // > 0
};

// Of one right-hand side. The estimates are those of the iteration that stopped it.
struct PcgResult {
  StopReason reason = StopReason::kRunning;
  std::size_t iterations = 0;
  double recursive_residual = 0;   // ||r|| by the recurrence
  double squared_error = 0;        // estimate of ||e||_A^2; infinite before 2 kDelay iterations
  double squared_energy = 0;       // ||u||_A^2
  double squared_decrease = 0;     // ||x||_A^2: what the squared error was at the start, less squared_error
  double smallest_eigenvalue = 0;  // of M A, the smallest Ritz value (an upper bound); 0 without iterations
};

// Coefficients of each iteration, and the smallest eigenvalue of their Lanczos matrix (Golub and Van Loan,
// 11.3.5): an upper bound of M A's smallest that tightens as the iteration converges; 0 without iterations.
struct Lanczos {
  std::vector<double> alpha, beta;
};
double smallest_ritz_value(const Lanczos&);

// The scalars on the device (kernels/pcg.clh).
enum PcgField : std::size_t {
  kPcgInitial = 8,
  kPcgAbsolute = 9,
  kPcgState = 11,
  kPcgIterations = 12,
  kPcgFields = 13,
  kPcgHistory = 3  // of each iteration, after the fields
};
// Those that a solve begins with, [kPcgFields][count].
template <class T>
std::vector<T> pcg_scalars(std::size_t count, const std::vector<double>& initial_energy,
                           const std::vector<double>& absolute_error);
// What they say at the end.
template <class T>
std::vector<PcgResult> pcg_results(const std::vector<T>& scalars, std::size_t count);

template <class T>
class Pcg {
 public:
  // unknowns: entries of one vector, even. Preallocates for `count` right-hand sides.
  Pcg(const Queue&, std::size_t unknowns, std::size_t count, const PcgOptions& = {});
  // r: in, right-hand sides; out, recursive residuals. x: out. load: the load part of r, for ||u||_A. Both
  // zero on constrained unknowns. initial_energy: ||guess||_A^2 each; absolute_error: an error ||e||_A that
  // is small enough too, each; both may be empty (zeros). Zero right-hand sides converge at once.
  std::vector<PcgResult> solve(LinearOperator<T>& a, LinearOperator<T>& preconditioner, std::size_t count,
                               Array<T>& r, const Array<T>& load, Array<T>& x,
                               const std::vector<double>& initial_energy = {},
                               const std::vector<double>& absolute_error = {});
  // z = M r and r . z for each of `count` vectors.
  std::vector<double> preconditioned_norm(LinearOperator<T>& preconditioner, std::size_t count,
                                          const Array<T>& r, Array<T>& z);
  std::size_t capacity() const { return capacity_; }
  PcgOptions& options() { return options_; }

 private:
  void begin(LinearOperator<T>& preconditioner, std::size_t count, Array<T>& r, Array<T>& x,
             const std::vector<double>& initial_energy, const std::vector<double>& absolute_error);
  void advance(LinearOperator<T>& a, std::size_t iteration, std::size_t count, Array<T>& r,
               const Array<T>& load, Array<T>& x);
  void turn(LinearOperator<T>& preconditioner, std::size_t iteration, std::size_t count, const Array<T>& r);
  void dot_two(const Array<T>& a, const Array<T>& b, const Array<T>& c, const Array<T>& d, std::size_t count);
  Queue queue_;
  PcgOptions options_;
  Range over_each(std::size_t count) const;
  std::size_t local_of_chunks() const { return group_ > 1 ? group_ : 16; }
  std::size_t nodes_, capacity_, chunk_, chunks_, group_;
  Kernel dot_, begin_, alpha_, update_, judge_, beta_, direction_;
  Array<T> z_, p_, ap_, partial_, scalars_;
};

}  // namespace teletact::service
