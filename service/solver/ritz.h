// Eigenvalues that conjugate gradients find on their way (Golub and Van Loan, 11.3.5).
#pragma once

#include <vector>

namespace teletact::service {

// Coefficients of each iteration.
struct Lanczos {
  std::vector<double> alpha, beta;
};

// Smallest eigenvalue of the Lanczos matrix, an upper bound of the smallest one of the preconditioned
// operator that tightens as the iteration converges; 0 without iterations.
double smallest_ritz_value(const Lanczos&);

}  // namespace teletact::service
