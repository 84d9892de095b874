// An upper bound of conjugate gradients' error, at every iteration, from the coefficients that they compute
// anyway: Gauss-Radau quadrature with a node at or below the smallest eigenvalue (Meurant and Tichy, On
// computing quadrature-based bounds for the A-norm of the error in conjugate gradients, Numer. Algorithms 62,
// 2013).
#pragma once

namespace teletact::service {

class RadauBound {
 public:
  // `min_eigenvalue`: at most the smallest one of M^-1 A, > 0.
  explicit RadauBound(double min_eigenvalue) : mu_(min_eigenvalue), gamma_(1 / min_eigenvalue) {}
  // After a step alpha from an iterate with r.z = rho to one with `next_rho`.
  void step(double alpha, double rho, double next_rho) {
    const double rest = gamma_ - alpha;
    // Rounding, or an eigenvalue below the one that was given: from here on it bounds nothing.
    if (!(rest >= 0)) holds_ = holds_ && rest >= -1e-12 * gamma_;
    gamma_ = rest > 0 ? rest / (mu_ * rest + next_rho / rho) : 0;
  }
  // Of the squared energy norm of the error of an iterate with r.z = rho.
  double squared(double rho) const { return gamma_ * rho; }
  bool holds() const { return holds_; }

 private:
  double mu_, gamma_;
  bool holds_ = true;
};

}  // namespace teletact::service
