// The factor of K of an older or a uniform modulus, as a preconditioner for the same tissue of another
// modulus and the same nu (T4.6). K is linear in E, so every eigenvalue of K_old^-1 K lies between the least
// and the greatest ratio of the moduli, whatever nu, the mesh or the pattern.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "service/tissue/grid.h"

namespace teletact::service {

// Immutable; any number of threads may solve at once. Made on the host, beside the touch path.
class TissueFactor {
 public:
  // free: [dof], 0 for an unknown that is held. Throws std::invalid_argument (field named) for an unusable
  // grid, material or mask, std::domain_error when K is not positive definite.
  TissueFactor(const TissueGrid&, const Material&, const std::vector<std::uint8_t>& free);
  ~TissueFactor();
  // z = K^-1 r (m from N/m) of one vector [dof]; zero where an unknown is held, whatever r is there.
  void solve(std::span<const double> r, std::span<double> z) const;
  // Greatest over least ratio of `material`'s moduli to these: a bound of the condition of K_old^-1 K.
  // Infinite for another nu or another number of elements.
  double condition(const Material& material) const;
  const std::vector<std::uint8_t>& free() const { return free_; }

 private:
  struct Factor;
  Material material_;
  std::vector<std::uint8_t> free_;
  std::unique_ptr<Factor> factor_;
};

// Most iterations of conjugate gradients until the energy norm of the error has fallen to `reduction` of what
// it was, 2 ((sqrt c - 1) / (sqrt c + 1))^k <= reduction (Saad, Iterative Methods, eq. 6.128). `condition` >=
// 1 and finite, 0 < reduction < 1.
std::size_t most_iterations(double condition, double reduction);

}  // namespace teletact::service
