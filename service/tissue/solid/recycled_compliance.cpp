#include "service/tissue/solid/recycled_compliance.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace teletact::service {
namespace {

// Of a pair's forces, what must be new beyond those kept: less would magnify what its excess is off by.
constexpr double kMinNew = 1e-2;
// What dS may be beyond the pairs, over the most of what shares of energy let it be that it was found to be
// so far; and what is added to the latter: what lies far away is in no share.
constexpr double kBeyond = 0.7, kFloor = 2e-3;
// Of a contact's energy on layered tissue: more than this beyond the pairs is elsewhere.
constexpr double kMostlyNew = 0.25;

}  // namespace

RecycledCompliance::RecycledCompliance(const SolidGrid& grid, const LayeredTissue& tissue, std::size_t first,
                                       std::size_t count, const SurfaceCompliance& wide,
                                       const SurfaceCompliance& smooth, const SurfaceCompliance& periodic,
                                       double scale, std::size_t max_pairs)
    : grid_(grid),
      first_(first),
      count_(count),
      scale_(scale),
      largest_(std::max({1 / (scale * tissue.least) - 1, 1 - 1 / (scale * tissue.largest), 0.0})),
      wide_(wide),
      smooth_(smooth),
      periodic_(periodic),
      max_pairs_(max_pairs) {}

std::vector<Eigen::Index> RecycledCompliance::places(const std::vector<std::size_t>& unknowns) const {
  std::vector<Eigen::Index> out;
  out.reserve(unknowns.size());
  for (const std::size_t unknown : unknowns)
    out.push_back(static_cast<Eigen::Index>(unknown - first_ * grid_.columns()));
  return out;
}

Eigen::MatrixXd RecycledCompliance::columns(Eigen::VectorXd Pair::*field,
                                            const std::vector<Eigen::Index>& at) const {
  Eigen::MatrixXd out(at.size(), pairs_.size());
  for (std::size_t c = 0; c < pairs_.size(); ++c)
    out.col(static_cast<Eigen::Index>(c)) = ((*pairs_[c]).*field)(at);
  return out;
}

Eigen::VectorXd RecycledCompliance::scale_at(const std::vector<std::size_t>& unknowns) const {
  Eigen::VectorXd d = Eigen::VectorXd::Ones(static_cast<Eigen::Index>(unknowns.size()));
  for (std::size_t n = 0; felt_ && n < unknowns.size(); ++n)
    d[static_cast<Eigen::Index>(n)] = felt_->scale[static_cast<Eigen::Index>(unknowns[n] % grid_.columns())];
  return d;
}

Eigen::MatrixXd RecycledCompliance::guess_among(const std::vector<std::size_t>& unknowns) const {
  Eigen::MatrixXd g = wide_.among(unknowns);
  if (felt_) {
    const Eigen::VectorXd d = scale_at(unknowns);
    g.array() += smooth_.among(unknowns).array() * ((d * d.transpose()).array() - 1);
  }
  return scale_ * g;
}

void RecycledCompliance::add(const std::vector<std::size_t>& unknowns, const Eigen::VectorXd& force_n,
                             const RowExcess& excess) {
  if (!(force_n.squaredNorm() > 0)) return;
  const auto begin = static_cast<Eigen::Index>(first_ * grid_.columns());
  const auto size = static_cast<Eigen::Index>(count_ * grid_.columns());
  const auto moves = [&](const SurfaceCompliance& s, const Eigen::VectorXd& p) {
    return s.times(unknowns, p, first_, count_);
  };
  Pair pair{Eigen::VectorXd::Zero(size), excess.moved_m.segment(begin, size),
            excess.last_m.segment(begin, size), scale_ * moves(wide_, force_n)};
  const auto at = places(unknowns);
  pair.force(at) = force_n;
  if (scale_ != 1)
    pair.excess += (1 - scale_) * moves(periodic_, force_n);  // told beyond the factor's layers
  if (felt_) {
    Eigen::VectorXd further = moves(smooth_, scale_at(unknowns).cwiseProduct(force_n));
    for (std::size_t c = 0; c < count_; ++c)
      further.segment(static_cast<Eigen::Index>(c * grid_.columns()), felt_->scale.size()).array() *=
          felt_->scale.array();
    further = scale_ * (further - moves(smooth_, force_n));
    pair.guess += further, pair.excess -= further;
  }
  // What those kept make of it is not what it was found to be: by how much of what is new of it.
  const Eigen::MatrixXd q = columns(&Pair::force, at) * basis_, e = columns(&Pair::excess, at) * basis_,
                        g = columns(&Pair::guess, at) * basis_;
  const Eigen::VectorXd share = q.transpose() * force_n;
  const Eigen::VectorXd known = e * share + q * (e.transpose() * force_n - core_ * share);
  pair.share = (pair.excess(at) - known).norm() / (pair.guess(at) - g * share).norm() /
               (kFloor + max_beyond(unknowns, force_n));
  pairs_.push_front(std::make_shared<const Pair>(std::move(pair)));
  if (pairs_.size() > max_pairs_) pairs_.pop_back();
  orthonormalise();
}

// Gram and Schmidt, the newest first: those of which little is new beyond the newer ones are left out.
void RecycledCompliance::orthonormalise() {
  std::deque<std::shared_ptr<const Pair>> kept;
  Eigen::MatrixXd basis(0, 0);
  for (const auto& pair : pairs_) {
    const auto n = static_cast<Eigen::Index>(kept.size());
    Eigen::VectorXd among(n);  // p.p of those kept
    for (Eigen::Index c = 0; c < n; ++c) among[c] = kept[static_cast<std::size_t>(c)]->force.dot(pair->force);
    const Eigen::VectorXd share = basis.transpose() * among;
    const double squares = pair->force.squaredNorm(), rest = squares - share.squaredNorm();
    if (!(rest >= kMinNew * kMinNew * squares)) continue;
    basis.conservativeResizeLike(Eigen::MatrixXd::Zero(n + 1, n + 1));
    basis.col(n).head(n) = -(basis.topLeftCorner(n, n) * share);
    basis(n, n) = 1;
    basis.col(n) /= std::sqrt(rest);
    kept.push_back(pair);
  }
  pairs_ = std::move(kept);
  basis_ = std::move(basis);
  const auto n = static_cast<Eigen::Index>(pairs_.size());
  Eigen::MatrixXd core(n, n), gram(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < n; ++j) {
      const Pair &a = *pairs_[static_cast<std::size_t>(i)], &b = *pairs_[static_cast<std::size_t>(j)];
      core(i, j) = a.excess.dot(b.force);
      gram(i, j) = a.force.dot(b.guess);
    }
  // Q^T dS Q is symmetric but for what the pairs are off by. Of two entries the one with the newer pair's
  // forces and the older one's excess is taken: S' is then exact for the newest pair whatever the older are.
  core_ = basis_.transpose() * core * basis_;
  core_.triangularView<Eigen::StrictlyUpper>() = core_.transpose();
  gram_ = basis_.transpose() * gram * basis_;
}

Eigen::MatrixXd RecycledCompliance::among(const std::vector<std::size_t>& unknowns) const {
  Eigen::MatrixXd s = guess_among(unknowns);
  if (pairs_.empty()) return s;
  const auto at = places(unknowns);
  const Eigen::MatrixXd q = columns(&Pair::force, at) * basis_, e = columns(&Pair::excess, at) * basis_;
  const Eigen::MatrixXd half = (e - q * core_ / 2) * q.transpose();
  return s + half + half.transpose();
}

Eigen::VectorXd RecycledCompliance::moved_m(const std::vector<std::size_t>& nodes,
                                            const std::vector<std::size_t>& unknowns,
                                            const Eigen::VectorXd& force_n) const {
  std::vector<std::size_t> along_y;
  for (const std::size_t node : nodes) along_y.push_back(node + grid_.columns());
  const auto between = [&](const SurfaceCompliance& s) { return s.between(along_y, unknowns); };
  Eigen::VectorXd moved = between(wide_) * force_n;
  if (felt_)
    moved += between(smooth_).cwiseProduct(
                 ((scale_at(along_y) * scale_at(unknowns).transpose()).array() - 1).matrix()) *
             force_n;
  moved *= scale_;
  if (pairs_.empty()) return moved;
  const auto at = places(along_y), from = places(unknowns);
  const Eigen::MatrixXd q_at = columns(&Pair::force, at) * basis_, e_at = columns(&Pair::excess, at) * basis_,
                        q = columns(&Pair::force, from) * basis_, e = columns(&Pair::excess, from) * basis_;
  const Eigen::VectorXd share = q.transpose() * force_n;
  return moved + e_at * share + q_at * (e.transpose() * force_n - core_ * share);
}

Eigen::VectorXd RecycledCompliance::wider_m(const std::vector<std::size_t>& unknowns,
                                            const Eigen::VectorXd& force_n) const {
  return scale_ * ((wide_.among(unknowns) - periodic_.among(unknowns)) * force_n);
}

// Where p presses.
double RecycledCompliance::max_beyond(const std::vector<std::size_t>& unknowns,
                                      const Eigen::VectorXd& p) const {
  if (!felt_) return largest_;
  double most = 0;
  for (std::size_t n = 0; n < unknowns.size(); ++n)
    most += std::abs(p[static_cast<Eigen::Index>(n)]) *
            felt_->beyond[static_cast<Eigen::Index>(unknowns[n] % grid_.columns())];
  return most / p.lpNorm<1>();
}

Eigen::VectorXd RecycledCompliance::error_between(const std::vector<std::size_t>& unknowns,
                                                  const Eigen::MatrixXd& a, const Eigen::VectorXd& b) const {
  const Eigen::MatrixXd g = guess_among(unknowns);
  double most = max_beyond(unknowns, b);
  const auto at = places(unknowns);
  const Eigen::MatrixXd q = columns(&Pair::force, at) * basis_, l = columns(&Pair::guess, at) * basis_;
  const auto beyond = [&](const Eigen::VectorXd& v) {  // the pairs: its norm by G
    const Eigen::VectorXd share = q.transpose() * v;
    return std::sqrt(
        std::max(0.0, v.dot(g * v) - 2 * share.dot(l.transpose() * v) + share.dot(gram_ * share)));
  };
  const double right = beyond(b);
  // What was learned elsewhere says little of a patch that is mostly new: there the bound holds.
  if (!(right * right > kMostlyNew * b.dot(g * b))) {
    double found = 0;
    for (const auto& pair : pairs_) found = std::max(found, pair->share);
    most = (kFloor + most) * std::min(1.0, kBeyond * found);
  }
  const Eigen::VectorXd last = columns(&Pair::last, at) * (basis_ * (q.transpose() * b));
  Eigen::VectorXd error(a.cols());
  for (Eigen::Index c = 0; c < a.cols(); ++c)
    error[c] = most * beyond(a.col(c)) * right + std::abs(a.col(c).dot(last));
  return error;
}

}  // namespace teletact::service
