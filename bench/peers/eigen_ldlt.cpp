// Eigen's sparse Cholesky (LDL^T, up-looking, AMD ordering).
#include <Eigen/SparseCholesky>

#include "bench/peers/factored.h"

namespace teletact::bench {

std::unique_ptr<Peer> make_eigen_ldlt() {
  using Factor = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>;
  return std::make_unique<Factored<Factor>>("Eigen SimplicialLDLT");
}

}  // namespace teletact::bench
