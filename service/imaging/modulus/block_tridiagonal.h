// A general block tridiagonal system with equal blocks (not symmetric), by block elimination from the first
// block to the last: what a grid of nodes numbered column by column gives. LU with pivoting inside the
// blocks; no pivoting between them, so the elimination must be stable by itself: `solve` measures the
// residual.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace teletact::service {

struct BlockTridiagonal {
  // `count` block rows of `size`: lower[k] x_(k-1) + diagonal[k] x_k + upper[k] x_(k+1) = b_k.
  BlockTridiagonal(Eigen::Index count, Eigen::Index size);
  std::vector<Eigen::MatrixXd> diagonal, lower, upper;
  struct Solution {
    Eigen::MatrixXd x;    // column k is block k
    double residual = 0;  // || b - A x || / || b ||, 0 for b = 0
  };
  // `b`: column k is block k. Throws std::domain_error when a block is singular. The blocks are gone after.
  Solution solve(const Eigen::MatrixXd& b);
};

}  // namespace teletact::service
