#include "service/imaging/modulus/sparse_factor.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <utility>

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

using Eigen::Index, Eigen::MatrixXd;

// The first columns of a symmetric matrix, of which the lower half is there, become L's; the rest what they
// leave of it. False: not positive definite.
bool eliminate(Index columns, MatrixXd& a, Work& work) {
  constexpr Index kAtOnce = 32;
  for (Index k = 0, n = 0; k < columns; k += n) {
    n = std::min(kAtOnce, columns - k);
    const Index below = a.rows() - k - n;
    Eigen::Ref<MatrixXd> own = a.block(k, k, n, n);
    const Eigen::LLT<Eigen::Ref<MatrixXd>> factor(own);
    if (factor.info() != Eigen::Success || !(own.diagonal().array() > 0).all()) return false;
    auto under = a.block(k + n, k, below, n);
    own.triangularView<Eigen::Lower>().transpose().solveInPlace<Eigen::OnTheRight>(under);
    a.bottomRightCorner(below, below).selfadjointView<Eigen::Lower>().rankUpdate(under, -1);
    work.add(below * below * n / 2);
  }
  return true;
}

double dot(const double* a, const double* b, Index size) {
  using Values = Eigen::Map<const Eigen::VectorXd>;
  return Values(a, size).dot(Values(b, size));
}

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

// The lower half of the matrix in the order of elimination.
SparseFactor::Sparse SparseFactor::ordered(const Sparse& a) const {
  Sparse lower(a.cols(), a.cols());
  check_cancelled();
  lower.selfadjointView<Eigen::Lower>() = a.selfadjointView<Eigen::Lower>().twistedBy(place_);
  check_cancelled();
  return lower;
}

// The elimination tree (-1: a root), and how many entries each column of L has: those of row k are met on the
// ways from its entries in A up the tree to k.
std::vector<int> SparseFactor::parents(const Sparse& lower, std::vector<int>& entries) const {
  const Sparse upper = lower.transpose();
  const auto n = static_cast<std::size_t>(lower.cols());
  std::vector<int> parent(n, -1), seen(n, -1);
  entries.assign(n, 1);
  Work work;
  for (int k = 0; k < static_cast<int>(n); ++k) {
    seen[static_cast<std::size_t>(k)] = k;
    for (Sparse::InnerIterator it(upper, k); it; ++it)
      for (auto i = static_cast<std::size_t>(it.index()); seen[i] != k;
           i = static_cast<std::size_t>(parent[i])) {
        if (parent[i] < 0) parent[i] = k;
        seen[i] = k;
        ++entries[i];
        work.add(1);
      }
  }
  return parent;
}

// Of its columns: those of A, and those of the fronts below it.
void SparseFactor::add_rows(const Sparse& lower, const Front& f, std::vector<int>& seen) {
  const auto first = row_.begin() + column_[static_cast<std::size_t>(f.first)];
  auto last = first;
  const auto add = [&](int row) {
    if (std::exchange(seen[static_cast<std::size_t>(row)], f.first) != f.first) *last++ = row;
  };
  for (int k = f.first; k < f.end; ++k) add(k);
  for (int k = f.first; k < f.end; ++k)
    for (Sparse::InnerIterator it(lower, k); it; ++it) add(static_cast<int>(it.index()));
  for (const std::size_t b : f.below) {
    const Front& below = fronts_[b];
    const auto of = row_.begin() + column_[static_cast<std::size_t>(below.first)];
    std::for_each(of + (below.end - below.first), of + rows_of(below), add);
  }
  std::sort(first + (f.end - f.first), last);
  for (int k = f.first + 1; k < f.end; ++k)
    std::copy(first + (k - f.first), last, row_.begin() + column_[static_cast<std::size_t>(k)]);
}

void SparseFactor::analyze(const Sparse& a, const std::vector<int>& order) {
  analyzed_ = false;
  const auto n = static_cast<std::size_t>(a.cols());
  place_.resize(a.cols());
  for (std::size_t k = 0; k < n; ++k) place_.indices()[order[k]] = static_cast<int>(k);
  const Sparse lower = ordered(a);
  std::vector<int> entries, front_of(n), seen(n, -1);
  const std::vector<int> parent = parents(lower, entries);
  column_.assign(n + 1, 0);
  for (std::size_t k = 0; k < n; ++k) column_[k + 1] = column_[k] + entries[k];
  row_.clear(), value_.clear(), fronts_.clear();
  grow(row_, static_cast<std::size_t>(column_[n]));
  grow(value_, static_cast<std::size_t>(column_[n]));
  for (std::size_t k = 0; k < n; ++k) {
    const int own = static_cast<int>(k);
    if (k > 0 && parent[k - 1] == own && entries[k - 1] == entries[k] + 1)
      ++fronts_.back().end;
    else
      fronts_.push_back({own, own + 1, {}});
    front_of[k] = static_cast<int>(fronts_.size()) - 1;
  }
  Work work;
  for (std::size_t f = 0; f < fronts_.size(); ++f) {
    add_rows(lower, fronts_[f], seen);
    work.add(rows_of(fronts_[f]) * (fronts_[f].end - fronts_[f].first));
    if (const int up = parent[static_cast<std::size_t>(fronts_[f].end) - 1]; up >= 0)
      fronts_[static_cast<std::size_t>(front_of[static_cast<std::size_t>(up)])].below.push_back(f);
  }
  analyzed_ = true;
}

bool SparseFactor::factorize(const Sparse& a) {
  const Sparse lower = ordered(a);
  std::vector<MatrixXd> left(fronts_.size());  // by each, to the front above it: its lower half
  std::vector<Index> at(static_cast<std::size_t>(a.cols()));  // of a row in the front at hand
  MatrixXd dense;
  Work work;
  for (std::size_t k = 0; k < fronts_.size(); ++k) {
    const Front& f = fronts_[k];
    const Index size = rows_of(f), columns = f.end - f.first;
    const int* const row = row_.data() + column_[static_cast<std::size_t>(f.first)];
    for (Index r = 0; r < size; ++r) at[static_cast<std::size_t>(row[r])] = r;
    dense.setZero(size, size);
    for (int c = f.first; c < f.end; ++c)
      for (Sparse::InnerIterator it(lower, c); it; ++it)
        dense(at[static_cast<std::size_t>(it.index())], c - f.first) += it.value();
    for (const std::size_t b : f.below) {
      const int* const its = row_.data() + column_[static_cast<std::size_t>(fronts_[b].end) - 1] + 1;
      for (Index c = 0; c < left[b].cols(); ++c)
        for (Index r = c; r < left[b].rows(); ++r)
          dense(at[static_cast<std::size_t>(its[r])], at[static_cast<std::size_t>(its[c])]) += left[b](r, c);
      left[b].resize(0, 0);
    }
    work.add(size * size);
    if (!eliminate(columns, dense, work)) return false;
    left[k] = dense.bottomRightCorner(size - columns, size - columns);
    for (Index c = 0; c < columns; ++c)
      std::copy_n(&dense(c, c), size - c, value_.begin() + column_[static_cast<std::size_t>(f.first + c)]);
  }
  return true;
}

// Of each front the rows below it together: what its columns share is read once, and one behind the other.
Eigen::VectorXd SparseFactor::solve(const Eigen::VectorXd& b) const {
  Eigen::VectorXd x = place_ * b;
  std::vector<double> part(static_cast<std::size_t>(x.size()));
  double* const sum = part.data();
  Work work;
  for (const Front& f : fronts_) {
    const Index columns = f.end - f.first, below = rows_of(f) - columns;
    double* const own = x.data() + f.first;
    const int* const row = row_.data() + column_[static_cast<std::size_t>(f.end) - 1] + 1;
    std::fill_n(sum, below, 0.0);
    for (Index k = 0; k < columns; ++k) {
      const double* l = value_.data() + column_[static_cast<std::size_t>(f.first + k)];
      const double solved = own[k] /= *l++;
      for (Index r = k + 1; r < columns; ++r) own[r] -= *l++ * solved;
      for (Index r = 0; r < below; ++r) sum[r] += l[r] * solved;
    }
    for (Index r = 0; r < below; ++r) x[row[r]] -= sum[r];
    work.add(columns * rows_of(f));
  }
  for (auto f = fronts_.rbegin(); f != fronts_.rend(); ++f) {
    const Index columns = f->end - f->first, below = rows_of(*f) - columns;
    double* const own = x.data() + f->first;
    const int* const row = row_.data() + column_[static_cast<std::size_t>(f->end) - 1] + 1;
    for (Index r = 0; r < below; ++r) sum[r] = x[row[r]];
    for (Index k = columns; k-- > 0;) {
      const double* const l = value_.data() + column_[static_cast<std::size_t>(f->first + k)];
      const Index under = columns - k - 1;
      own[k] = (own[k] - dot(l + 1, own + k + 1, under) - dot(l + 1 + under, sum, below)) / *l;
    }
    work.add(columns * rows_of(*f));
  }
  return place_.inverse() * x;
}

// A row in which all columns are 0 has nothing to give to those below.
SparseFactor::Columns SparseFactor::solve_columns(const Columns& b) const {
  constexpr int kWidth = Columns::ColsAtCompileTime;
  using Row = Eigen::Matrix<double, 1, kWidth>;
  Columns x = place_ * b;
  Work work;
  const auto end = [this](Eigen::Index k) { return column_[static_cast<std::size_t>(k) + 1]; };
  for (Eigen::Index k = 0; k < x.rows(); ++k) {
    const Eigen::Index first = column_[static_cast<std::size_t>(k)], last = end(k);
    if ((x.row(k).array() == 0).all()) continue;
    const Row solved = x.row(k) /= value_[static_cast<std::size_t>(first)];
    for (auto p = static_cast<std::size_t>(first) + 1; p < static_cast<std::size_t>(last); ++p)
      x.row(row_[p]) -= value_[p] * solved;
    work.add(kWidth * (last - first));
  }
  for (Eigen::Index k = x.rows(); k-- > 0;) {
    const Eigen::Index first = column_[static_cast<std::size_t>(k)], last = end(k);
    Row rest = x.row(k);
    for (auto p = static_cast<std::size_t>(first) + 1; p < static_cast<std::size_t>(last); ++p)
      rest -= value_[p] * x.row(row_[p]);
    x.row(k) = rest / value_[static_cast<std::size_t>(first)];
    work.add(kWidth * (last - first));
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
