#include "service/contact/patch_factor.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace teletact::service {

using Eigen::Index;
using Eigen::VectorXd;

// Columns of L, then D^-1 L^-1 b on the way. False when a pivot is not positive or not finite.
template <int Rows>
bool PatchFactor::factor(const Eigen::MatrixXd& a, Column& b) {
  using Part = Eigen::Matrix<double, Rows, 1>;
  Part rest = b.template head<Rows>();
  for (Index k = 0; k < size_; ++k) {
    Part column = Part::Zero(), other = Part::Zero();  // two sums that need not wait for each other
    column.segment(k, size_ - k) = a.col(k).tail(size_ - k);
    Index j = 0;
    for (; j + 1 < k; j += 2) {
      column -= (l_(k, j) * pivots_[j]) * l_.col(j).template head<Rows>();
      other -= (l_(k, j + 1) * pivots_[j + 1]) * l_.col(j + 1).template head<Rows>();
    }
    if (j < k) column -= (l_(k, j) * pivots_[j]) * l_.col(j).template head<Rows>();
    column += other;
    const double pivot = column[k];
    if (!(pivot > 0) || !std::isfinite(pivot)) return false;
    pivots_[k] = pivot;
    column *= 1 / pivot;
    column.head(k).setZero();
    l_.col(k).template head<Rows>() = column;
    const double y = rest[k];
    b[k] = y / pivot;
    rest -= y * column;
  }
  return true;
}

// L^T x = b, by blocks: one number at a time would wait for memory at each.
void PatchFactor::substitute_back(Column& b) const {
  for (Index begin = (size_ - 1) / kBlock * kBlock; begin >= 0; begin -= kBlock) {
    const Index end = std::min(begin + kBlock, size_);
    double x[kBlock];
    for (Index k = begin; k < end; ++k) {
      x[k - begin] = b[k];
      for (Index block = begin + kBlock; block < size_; block += kBlock)
        x[k - begin] -= l_.col(k).segment<kBlock>(block).dot(b.segment<kBlock>(block));
    }
    for (Index k = end; k-- > begin;)
      for (Index i = begin; i < k; ++i) x[i - begin] -= l_(k, i) * x[k - begin];
    std::copy(x, x + (end - begin), b.data() + begin);
  }
}

void PatchFactor::factor_and_solve(const Eigen::MatrixXd& a, Eigen::Ref<VectorXd> b) {
  size_ = a.rows();
  bool positive = true;
  if (size_ > kSmall) {
    large_.compute(a);
    positive = large_.info() == Eigen::Success;
    if (positive) large_.solveInPlace(b);
  } else {
    Column x = Column::Zero();
    x.head(size_) = b;
    positive = size_ <= 8    ? factor<8>(a, x)
               : size_ <= 16 ? factor<16>(a, x)
               : size_ <= 24 ? factor<24>(a, x)
                             : factor<32>(a, x);
    if (positive && size_ > 0) substitute_back(x);
    b = x.head(size_);
  }
  if (!positive)
    throw std::domain_error("contact: the compliance of the contact nodes is not positive definite");
}

void PatchFactor::solve(Eigen::Ref<VectorXd> b) const {
  if (size_ > kSmall) {
    large_.solveInPlace(b);
    return;
  }
  Column rest = Column::Zero(), x = Column::Zero();
  rest.head(size_) = b;
  const Index end = (size_ + kBlock - 1) / kBlock * kBlock;
  for (Index k = 0; k < size_; ++k) {
    const double y = rest[k];
    x[k] = y / pivots_[k];
    for (Index block = k / kBlock * kBlock; block < end; block += kBlock)
      rest.segment<kBlock>(block) -= y * l_.col(k).segment<kBlock>(block);
  }
  if (size_ > 0) substitute_back(x);
  b = x.head(size_);
}

}  // namespace teletact::service
