#include "service/imaging/sparse_factor.h"

#include <cmath>
#include <vector>

#include "service/device/look.h"

namespace teletact::service {

namespace {

constexpr Eigen::Index kLookEvery = 4'000'000;  // multiply-adds: some milliseconds

}  // namespace

void SparseFactor::factorize(const Sparse& a) {
  Sparse upper(a.cols(), a.cols());
  upper.selfadjointView<Eigen::Upper>() = a.selfadjointView<Eigen::Lower>().twistedBy(m_P);
  look();
  factorize_ordered(upper);
}

// Row by row of L (up-looking): the pattern of a row from the elimination tree, then a sparse triangular
// solve with the rows above.
void SparseFactor::factorize_ordered(const Sparse& upper) {
  const int size = static_cast<int>(upper.rows());
  const int* const column = m_matrix.outerIndexPtr();
  int* const row = m_matrix.innerIndexPtr();
  double* const value = m_matrix.valuePtr();
  const auto n = static_cast<std::size_t>(size);
  std::vector<double> y(n, 0.0);
  std::vector<int> pattern(n), seen(n, -1);
  m_factorizationIsOk = false;
  m_info = Eigen::Success;
  Eigen::Index done = 0;
  for (int k = 0; k < size; ++k) {
    int top = size;
    seen[static_cast<std::size_t>(k)] = k;
    m_nonZerosPerCol[k] = 0;
    y[static_cast<std::size_t>(k)] = 0;
    for (Sparse::InnerIterator it(upper, k); it; ++it) {
      int i = static_cast<int>(it.index());
      if (i > k) continue;
      y[static_cast<std::size_t>(i)] += it.value();
      int length = 0;
      for (; seen[static_cast<std::size_t>(i)] != k; i = m_parent[i]) {
        pattern[static_cast<std::size_t>(length++)] = i;
        seen[static_cast<std::size_t>(i)] = k;
      }
      while (length > 0)
        pattern[static_cast<std::size_t>(--top)] = pattern[static_cast<std::size_t>(--length)];
    }
    double d = y[static_cast<std::size_t>(k)];
    y[static_cast<std::size_t>(k)] = 0;
    for (; top < size; ++top) {
      const int i = pattern[static_cast<std::size_t>(top)];
      const double right = y[static_cast<std::size_t>(i)];
      y[static_cast<std::size_t>(i)] = 0;
      const double entry = right / value[column[i]];
      const int end = column[i] + m_nonZerosPerCol[i];
      for (int p = column[i] + 1; p < end; ++p) y[static_cast<std::size_t>(row[p])] -= value[p] * entry;
      d -= entry * entry;
      row[end] = k;
      value[end] = entry;
      ++m_nonZerosPerCol[i];
      done += end - column[i];
    }
    const int diagonal = column[k] + m_nonZerosPerCol[k]++;
    row[diagonal] = k;
    if (d <= 0) {
      m_info = Eigen::NumericalIssue;
      break;
    }
    value[diagonal] = std::sqrt(d);
    if (done < kLookEvery) continue;
    done = 0;
    look();
  }
  m_factorizationIsOk = true;
}

Eigen::VectorXd SparseFactor::solve(const Eigen::VectorXd& b) const {
  look();
  Eigen::VectorXd x = m_P * b;
  matrixL().solveInPlace(x);
  look();
  matrixU().solveInPlace(x);
  return m_Pinv * x;
}

}  // namespace teletact::service
