#include "tests/reference/kkt.h"

#include <Eigen/LU>
#include <stdexcept>

namespace teletact::reference {

KktSolution solve_kkt(const Eigen::SparseMatrix<double>& k, const Eigen::MatrixXd& b,
                      const Eigen::VectorXd& f, const Eigen::VectorXd& w) {
  const Eigen::Index n = k.rows(), m = b.rows();
  // Scaling the constraints by the stiffness keeps the pivots comparable; lambda is scaled back below.
  const double scale = k.diagonal().cwiseAbs().maxCoeff();
  Eigen::MatrixXd kkt = Eigen::MatrixXd::Zero(n + m, n + m);
  kkt.topLeftCorner(n, n) = k;
  kkt.topRightCorner(n, m) = scale * b.transpose();
  kkt.bottomLeftCorner(m, n) = scale * b;
  Eigen::VectorXd right(n + m);
  right << f, scale * w;
  const Eigen::PartialPivLU<Eigen::Ref<Eigen::MatrixXd>> lu(kkt);
  const Eigen::VectorXd solution = lu.solve(right);
  if (!solution.allFinite())
    throw std::domain_error("solve_kkt: singular: B is rank deficient or K unsupported");
  return {solution.head(n), scale * solution.tail(m)};
}

}  // namespace teletact::reference
