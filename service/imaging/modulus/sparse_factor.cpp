#include "service/imaging/modulus/sparse_factor.h"

#include <cmath>

#include "service/device/cancellation.h"

namespace teletact::service {

namespace {

// Looks up after so much work.
class Work {
 public:
  void add(Eigen::Index multiply_adds) {
    done_ += multiply_adds;
    if (done_ < kMax) return;
    done_ = 0;
    check_cancelled();
  }

 private:
  static constexpr Eigen::Index kMax = 2'000'000;  // some milliseconds
  Eigen::Index done_ = 0;
};

struct Cells {
  std::size_t left, right, top, bottom;  // the second and the fourth are the first beyond
};

void dissect(const Cells& c, std::size_t nx, std::vector<int>& order) {
  if (c.left >= c.right || c.top >= c.bottom) return;
  Cells before = c, after = c, between = c;
  if (c.right - c.left >= c.bottom - c.top) {
    const std::size_t middle = c.left + (c.right - c.left) / 2;
    before.right = between.left = middle, after.left = between.right = middle + 1;
  } else {
    const std::size_t middle = c.top + (c.bottom - c.top) / 2;
    before.bottom = between.top = middle, after.top = between.bottom = middle + 1;
  }
  dissect(before, nx, order);
  dissect(after, nx, order);
  for (std::size_t j = between.top; j < between.bottom; ++j)
    for (std::size_t i = between.left; i < between.right; ++i) order.push_back(static_cast<int>(i + nx * j));
}

}  // namespace

std::vector<int> nested_dissection(std::size_t nx, std::size_t ny) {
  std::vector<int> order;
  order.reserve(nx * ny);
  dissect({0, nx, 0, ny}, nx, order);
  return order;
}

// The upper half of the matrix in the order of elimination.
SparseFactor::Sparse SparseFactor::ordered(const Sparse& a) const {
  Sparse upper(a.cols(), a.cols());
  check_cancelled();
  upper.selfadjointView<Eigen::Upper>() = a.selfadjointView<Eigen::Lower>().twistedBy(place_);
  check_cancelled();
  return upper;
}

// The elimination tree, and how many entries each column of L has: those of row k are met on the ways from
// its entries in A up the tree to k.
void SparseFactor::analyze(const Sparse& a, const std::vector<int>& order) {
  const auto n = static_cast<std::size_t>(a.cols());
  place_.resize(a.cols());
  for (std::size_t k = 0; k < n; ++k) place_.indices()[order[k]] = static_cast<int>(k);
  const Sparse upper = ordered(a);
  parent_.assign(n, -1);
  std::vector<int> seen(n, -1);
  std::vector<Eigen::Index> below(n, 0);
  Work work;
  for (int k = 0; k < static_cast<int>(n); ++k) {
    seen[static_cast<std::size_t>(k)] = k;
    for (Sparse::InnerIterator it(upper, k); it; ++it)
      for (auto i = static_cast<std::size_t>(it.index()); seen[i] != k;
           i = static_cast<std::size_t>(parent_[i])) {
        if (parent_[i] < 0) parent_[i] = k;
        seen[i] = k;
        ++below[i];
        work.add(1);
      }
  }
  column_.assign(n + 1, 0);
  for (std::size_t k = 0; k < n; ++k) column_[k + 1] = column_[k] + below[k] + 1;
  row_.clear(), value_.clear();
  grow(row_, static_cast<std::size_t>(column_[n]));
  grow(value_, static_cast<std::size_t>(column_[n]));
}

// Row by row of L (up-looking): the pattern of a row from the elimination tree, then a sparse triangular
// solve with the rows above.
bool SparseFactor::factorize(const Sparse& a) {
  const Sparse upper = ordered(a);
  const auto n = static_cast<std::size_t>(a.cols());
  std::vector<double> y(n, 0.0);
  std::vector<int> pattern(n), seen(n, -1);
  std::vector<Eigen::Index> end(column_.begin(), column_.end() - 1);  // of what each column has so far
  int* const row = row_.data();
  double* const value = value_.data();
  Work work;
  for (std::size_t k = 0; k < n; ++k) {
    const int own = static_cast<int>(k);
    std::size_t top = n;
    seen[k] = own;
    for (Sparse::InnerIterator it(upper, own); it; ++it) {
      auto i = static_cast<std::size_t>(it.index());
      y[i] += it.value();
      std::size_t length = 0;
      for (; seen[i] != own; i = static_cast<std::size_t>(parent_[i])) {
        pattern[length++] = static_cast<int>(i);
        seen[i] = own;
      }
      while (length > 0) pattern[--top] = pattern[--length];
    }
    double d = y[k];
    y[k] = 0;
    for (; top < n; ++top) {
      const auto i = static_cast<std::size_t>(pattern[top]);
      const double right = y[i];
      y[i] = 0;
      const Eigen::Index first = column_[i], last = end[i]++;
      const double entry = right / value[first];
      for (Eigen::Index p = first + 1; p < last; ++p) y[static_cast<std::size_t>(row[p])] -= value[p] * entry;
      d -= entry * entry;
      row[last] = own;
      value[last] = entry;
      work.add(last - first);
    }
    if (!(d > 0)) return false;
    const Eigen::Index diagonal = end[k]++;
    row[diagonal] = own;
    value[diagonal] = std::sqrt(d);
  }
  return true;
}

Eigen::VectorXd SparseFactor::solve(const Eigen::VectorXd& b) const {
  Eigen::VectorXd x = place_ * b;
  Work work;
  for (Eigen::Index k = 0; k < x.size(); ++k) {
    const Eigen::Index first = column_[static_cast<std::size_t>(k)],
                       last = column_[static_cast<std::size_t>(k) + 1];
    if (x[k] == 0) continue;
    x[k] /= value_[static_cast<std::size_t>(first)];
    const double solved = x[k];
    for (auto p = static_cast<std::size_t>(first) + 1; p < static_cast<std::size_t>(last); ++p)
      x[row_[p]] -= solved * value_[p];
    work.add(last - first);
  }
  for (Eigen::Index k = x.size(); k-- > 0;) {
    const Eigen::Index first = column_[static_cast<std::size_t>(k)],
                       last = column_[static_cast<std::size_t>(k) + 1];
    double rest = x[k];
    for (auto p = static_cast<std::size_t>(first) + 1; p < static_cast<std::size_t>(last); ++p)
      rest -= value_[p] * x[row_[p]];
    x[k] = rest / value_[static_cast<std::size_t>(first)];
    work.add(last - first);
  }
  return place_.inverse() * x;
}

SparseFactor::Columns SparseFactor::solve_columns(const Columns& b) const {
  Columns x = place_ * b;
  Work work;
  const auto end = [this](Eigen::Index k) { return column_[static_cast<std::size_t>(k) + 1]; };
  for (Eigen::Index k = 0; k < x.rows(); ++k) {
    const Eigen::Index first = column_[static_cast<std::size_t>(k)], last = end(k);
    const Eigen::Matrix<double, 1, 8> solved = x.row(k) /= value_[static_cast<std::size_t>(first)];
    for (auto p = static_cast<std::size_t>(first) + 1; p < static_cast<std::size_t>(last); ++p)
      x.row(row_[p]) -= value_[p] * solved;
    work.add(8 * (last - first));
  }
  for (Eigen::Index k = x.rows(); k-- > 0;) {
    const Eigen::Index first = column_[static_cast<std::size_t>(k)], last = end(k);
    Eigen::Matrix<double, 1, 8> rest = x.row(k);
    for (auto p = static_cast<std::size_t>(first) + 1; p < static_cast<std::size_t>(last); ++p)
      rest -= value_[p] * x.row(row_[p]);
    x.row(k) = rest / value_[static_cast<std::size_t>(first)];
    work.add(8 * (last - first));
  }
  return place_.inverse() * x;
}

// The inverse Z where L has entries, from the last column to the first (Takahashi, Fagan and Chin 1973): Z L
// = L^-T, so that sum_(k >= j) Z_ik L_kj is 0 below the diagonal and 1 / L_jj on it.
Eigen::VectorXd SparseFactor::inverse_diagonal() const {
  const std::size_t n = column_.size() - 1;
  std::vector<double> z(value_.size(), 0.0);
  std::vector<std::size_t> place_of(n, 0);  // of a row in the column at hand; 0: it has none
  Eigen::VectorXd diagonal(static_cast<Eigen::Index>(n));
  Work work;
  for (std::size_t j = n; j-- > 0;) {
    const auto first = static_cast<std::size_t>(column_[j]), last = static_cast<std::size_t>(column_[j + 1]);
    for (std::size_t p = first + 1; p < last; ++p) place_of[static_cast<std::size_t>(row_[p])] = p;
    for (std::size_t p = first + 1; p < last; ++p) {
      const auto k = static_cast<std::size_t>(row_[p]);
      auto q = static_cast<std::size_t>(column_[k]);
      z[p] -= value_[p] * z[q];
      for (const auto end = static_cast<std::size_t>(column_[k + 1]); ++q < end;)
        if (const std::size_t other = place_of[static_cast<std::size_t>(row_[q])]; other > 0)
          z[p] -= value_[other] * z[q], z[other] -= value_[p] * z[q];
      work.add(column_[k + 1] - column_[k]);
    }
    double sum = 1 / value_[first];
    for (std::size_t p = first + 1; p < last; ++p) {
      z[p] /= value_[first];
      sum -= value_[p] * z[p];
      place_of[static_cast<std::size_t>(row_[p])] = 0;
    }
    z[first] = diagonal[static_cast<Eigen::Index>(j)] = sum / value_[first];
  }
  return place_.inverse() * diagonal;
}

}  // namespace teletact::service
