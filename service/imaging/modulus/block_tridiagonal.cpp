#include "service/imaging/modulus/block_tridiagonal.h"

#include <sys/mman.h>

#include <Eigen/LU>
#include <cstdint>
#include <stdexcept>
#include <utility>

#include "service/device/cancellation.h"

namespace teletact::service {

namespace {

// Its pages at once. Left to the allocator, those of all blocks go together when the last one does, which
// takes 0.2 s for the 2 GB at the limits.
void give_back(Eigen::MatrixXd& block) {
  constexpr std::uintptr_t kPage = 4096, kLarge = 16 * kPage;
  const auto begin = reinterpret_cast<std::uintptr_t>(block.data());
  const std::uintptr_t end = begin + sizeof(double) * static_cast<std::uintptr_t>(block.size());
  const std::uintptr_t first = (begin + kPage - 1) / kPage * kPage, last = end / kPage * kPage;
  if (end - begin >= kLarge) madvise(reinterpret_cast<void*>(first), last - first, MADV_DONTNEED);
  block.resize(0, 0);
}

}  // namespace

BlockTridiagonal::BlockTridiagonal(Eigen::Index count, Eigen::Index size) {
  for (Eigen::Index k = 0; k < count; ++k) {
    check_cancelled();  // at the limits these are 2 GB
    for (auto* blocks : {&diagonal, &lower, &upper}) blocks->push_back(Eigen::MatrixXd::Zero(size, size));
  }
}

// D_0 = diagonal_0, D_k = diagonal_k - lower_k D_(k-1)^-1 upper_(k-1); then backwards.
BlockTridiagonal::Solution BlockTridiagonal::solve(const Eigen::MatrixXd& b) {
  const std::size_t count = diagonal.size();
  std::vector<Eigen::MatrixXd> carry(count);  // D_k^-1 upper_k
  Eigen::MatrixXd y = b;
  Eigen::MatrixXd d = diagonal[0];
  for (std::size_t k = 0; k < count; ++k) {
    check_cancelled();
    const auto column = static_cast<Eigen::Index>(k);
    const Eigen::PartialPivLU<Eigen::MatrixXd> lu(d);
    y.col(column) = lu.solve(y.col(column)).eval();
    if (!y.col(column).allFinite()) throw std::domain_error("a block of the system is singular");
    if (k + 1 == count) break;
    check_cancelled();
    carry[k] = lu.solve(upper[k]);
    check_cancelled();
    d = diagonal[k + 1];
    d.noalias() -= lower[k + 1] * carry[k];
    y.col(column + 1).noalias() -= lower[k + 1] * y.col(column);
  }
  for (std::size_t k = count - 1; k-- > 0;) {
    check_cancelled();
    y.col(static_cast<Eigen::Index>(k)).noalias() -= carry[k] * y.col(static_cast<Eigen::Index>(k) + 1);
    give_back(carry[k]);
  }
  Solution out{std::move(y), 0};
  Eigen::MatrixXd residual = b;
  for (std::size_t k = 0; k < count; ++k) {
    check_cancelled();
    const auto column = static_cast<Eigen::Index>(k);
    residual.col(column) -= diagonal[k] * out.x.col(column);
    if (k > 0) residual.col(column) -= lower[k] * out.x.col(column - 1);
    if (k + 1 < count) residual.col(column) -= upper[k] * out.x.col(column + 1);
    for (auto* blocks : {&diagonal, &lower, &upper}) give_back((*blocks)[k]);
  }
  if (b.norm() > 0) out.residual = residual.norm() / b.norm();
  return out;
}

}  // namespace teletact::service
