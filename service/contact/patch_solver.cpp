#include "service/contact/patch_solver.h"

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

namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kSettled = 1e-9;  // last step over p: the error after it is about the square of that
constexpr std::size_t kMaxIterations = 200;
constexpr double kMinShare = 0.1;            // of p that a step leaves
constexpr std::size_t kBoldIterations = 40;  // that let a node go at once when it is outside of its skin

// Lets nodes in that would be inside their skin without bearing anything, and those go that bear nothing.
void update_active(const PatchProgramme& q, const VectorXd& displacement, PatchSolution& s) {
  const Index first = q.first_node();
  s.active.clear();
  for (Index u = 0; u < first; ++u) s.active.push_back(u);
  for (std::size_t i = 0; i < q.stiffness.size(); ++i) {
    const Index u = first + Index(i);
    if (s.p[u] == 0) {
      const double t = q.thickness_m[i], y = (q.w[u] + t * (1 - kSkinMiddle) - displacement[u]) / t;
      constexpr double kMin = 1e-6, kMax = 0.5;  // of the skin's thickness
      if (y < kMin) continue;
      const double rest = std::min(y, kMax);
      s.p[u] = q.stiffness[i] * t * rest * rest / (1 - rest);
    }
    s.active.push_back(u);
  }
}

}  // namespace

VectorXd first_guess(const PatchProgramme& q, double indentation_m, double edge) {
  VectorXd p = VectorXd::Zero(q.w.size());
  for (Index u = q.first_node(); u < p.size(); ++u)
    p[u] = std::sqrt(std::max(0.0, q.w[u] / indentation_m - edge));
  const double curvature = p.dot(q.a * p);
  if (curvature > 0) p *= p.dot(q.w) / curvature;
  return p;
}

PatchSolution solve_patch(const PatchProgramme& q, VectorXd guess) {
  PatchSolution s;
  s.p = std::move(guess);
  s.skin.resize(q.stiffness.size());
  const Index first = q.first_node();
  VectorXd displacement = q.a * s.p, step;
  Eigen::MatrixXd matrix;
  while (++s.iterations < kMaxIterations) {
    update_active(q, displacement, s);
    displacement.noalias() = q.a * s.p;
    matrix = q.a(s.active, s.active);
    const Index n = Index(s.active.size());
    step.resize(n);
    for (Index k = 0; k < n; ++k) {
      const Index u = s.active[std::size_t(k)];
      step[k] = q.w[u] - displacement[u];
      if (u < first) continue;
      const std::size_t i = std::size_t(u - first);
      s.skin[i] = skin_state(s.p[u], q.stiffness[i], q.thickness_m[i]);
      step[k] += s.skin[i].gap_m;
      matrix(k, k) += s.skin[i].compliance;
    }
    s.factor.factor_and_solve(matrix, step);
    const double largest = s.p.lpNorm<Eigen::Infinity>();
    double change = 0;
    for (Index k = 0; k < n; ++k) {
      const Index u = s.active[std::size_t(k)];
      change = std::max(change, std::abs(step[k]));
      const double least = u < first ? -HUGE_VAL : kMinShare * s.p[u];
      s.p[u] += step[k];
      if (s.p[u] >= least) continue;
      const double within = q.w[u] + q.thickness_m[std::size_t(u - first)] * (1 - kSkinMiddle);
      s.p[u] = s.iterations < kBoldIterations && displacement[u] > within ? 0 : least;
    }
    if (!(change < HUGE_VAL)) break;  // NaN too
    if (change <= kSettled * largest) return s;
    displacement.noalias() = q.a * s.p;
  }
  throw std::domain_error("contact: the contact did not settle; the compliance is too ill-conditioned");
}

}  // namespace teletact::service
