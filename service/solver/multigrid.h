// Geometric multigrid on a structured grid of nodes with two unknowns each: one cycle, a symmetric positive
// definite preconditioner for conjugate gradients.
//
// Levels: every second line is dropped. Where elements are stretched both ways, across their short side first
// (NodeLines); where all are stretched one way, in both directions, and the smoother solves along the short
// side.
// Transfers: P bilinear by coordinates on the coarse lines; the fine node inside a coarse cell is in
// equilibrium with them, so that a coarse displacement without divergence stays one on the fine level
// (Schoeberl 1999: what makes multigrid robust in nu). Restriction P^T. Coarse operators: P^T A P on the
// device.
// Smoother: Chebyshev polynomial in M A (smoother.h), before, between and after visits to the coarser level
// (plan_cycle): it is its own transpose in the A inner product, so the cycle is symmetric. Coarsest level:
// exact, by a dense inverse computed in double on the host.
#pragma once

#include <cstdint>
#include <vector>

#include "service/solver/level_layout.h"
#include "service/solver/linear_operator.h"

namespace teletact::service {

// For vectors of T; it works in W: T, or float where T is double, at half the bytes.
template <class T, class W = T>
class Multigrid : public LinearOperator<T> {
 public:
  Multigrid(const Queue&, const NodeLines&);
  // Sets the finest operator, [9][ny][nx] blocks of 4 (kernels/stencil.clh), symmetric, constrained unknowns
  // as the identity, and computes the rest. Throws std::invalid_argument when the operator is found not to be
  // positive definite. S: double where the device has it, else float. free: [node][2], 1 or 0 for a
  // constrained unknown.
  template <class S>
  void set_operator(const Array<S>& stencil, const std::vector<std::uint8_t>& free);
  // z = M r for the first `count` vectors; r must vanish on constrained unknowns. Grows its vectors on first
  // use of a larger count.
  void apply(const Array<T>& r, Array<T>& z, std::size_t count) override;
  std::size_t levels() const { return lines_.size(); }
  std::size_t nodes(std::size_t level) const { return lines_[level].nodes(); }
  const std::vector<PlannedStep>& plan() const { return plan_; }
  // From this level on steps that follow each other are one launch.
  std::size_t first_small() const { return first_small_; }

 private:
  // What the set-up needs of a level on the device (kernels/galerkin.cl).
  template <class S>
  struct Level {
    Array<int> lines;
    Array<S> weights, free;
  };
  bool smooths_lines() const { return short_side_ != ShortSide::kNeither; }
  void set_header(const std::vector<std::vector<std::uint8_t>>& free);
  template <class S>
  void set_level(std::size_t level, const Array<S>& stencil, Array<int>& indefinite);
  template <class S>
  Array<S> coarse_operator(std::size_t level, const Array<S>& stencil, const std::vector<Level<S>>&);
  void invert_coarsest(const std::vector<double>& stencil);
  void reserve(std::size_t count);
  void launch(const PlannedStep&, const Array<T>& r, Array<T>& z, std::size_t count);
  void smooth_lines(const PlannedStep&, std::size_t count);
  Queue queue_;
  ShortSide short_side_;
  std::vector<ChebyshevStep> steps_;
  std::vector<NodeLines> lines_;         // of each level
  std::vector<GridTransfer> transfers_;  // from each level but the coarsest to the next
  std::vector<PlannedStep> plan_;
  std::size_t first_small_ = 0;  // level from which on steps run in one work-group
  HierarchyLayout layout_;
  Kernel residual_, smooth_, restriction_, prolong_, run_, pack_, unpack_;
  Kernel solve_lines_, line_step_;      // where lines are smoothed
  Array<int> table_;                    // the layout's, then the plan
  Array<W> constants_, vectors_;        // kernels/levels.clh
  std::vector<Array<W>> line_factors_;  // of each level, where lines are smoothed
  Array<W> line_solutions_;
  std::size_t reserved_ = 0;
};

}  // namespace teletact::service
