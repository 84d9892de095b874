#include "service/solid/recycled_compliance.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace teletact::service {
namespace {

// Of a pair's forces, what must be new beyond those kept: less would magnify what its excess is off by.
constexpr double kLeastNew = 1e-2;
// What dS over S0 may be beyond the pairs, over the most that it was between them.
constexpr double kBeyond = 2;
// Of a contact's energy on layered tissue: more than this beyond the pairs is elsewhere.
constexpr double kMostlyNew = 0.25;

}  // namespace

RecycledCompliance::RecycledCompliance(const SolidGrid& grid, const LayeredTissue& tissue, std::size_t first,
                                       std::size_t count, const SurfaceCompliance& wide,
                                       const SurfaceCompliance& periodic, double scale,
                                       std::size_t most_pairs)
    : grid_(grid),
      first_(first),
      count_(count),
      scale_(scale),
      largest_(std::max({1 / (scale * tissue.least) - 1, 1 - 1 / (scale * tissue.largest), 0.0})),
      wide_(wide),
      periodic_(periodic),
      most_pairs_(most_pairs) {}

std::vector<Eigen::Index> RecycledCompliance::places(const std::vector<std::size_t>& unknowns) const {
  std::vector<Eigen::Index> out;
  out.reserve(unknowns.size());
  for (const std::size_t unknown : unknowns)
    out.push_back(static_cast<Eigen::Index>(unknown - first_ * grid_.columns()));
  return out;
}

void RecycledCompliance::add(const std::vector<std::size_t>& unknowns, const Eigen::VectorXd& force_n,
                             const SurfaceExcess& excess) {
  if (!(force_n.squaredNorm() > 0)) return;
  const auto begin = static_cast<Eigen::Index>(first_ * grid_.columns());
  const auto size = static_cast<Eigen::Index>(count_ * grid_.columns());
  Pair pair{Eigen::VectorXd::Zero(size),
            excess.moved_m.segment(begin, size),
            excess.last_m.segment(begin, size),
            {}};
  pair.force(places(unknowns)) = force_n;
  const Eigen::VectorXd factors = periodic_.times(unknowns, force_n, grid_.nx, grid_.nz, first_, count_);
  pair.excess += (1 - scale_) * factors;  // it is told beyond the factor's layers
  pair.layered = scale_ * factors;
  const auto at = places(unknowns);
  pair.share = pair.excess(at).norm() / pair.layered(at).norm();
  pairs_.push_front(std::move(pair));
  if (pairs_.size() > most_pairs_) pairs_.pop_back();
  const auto most = static_cast<Eigen::Index>(pairs_.size());
  for (Eigen::MatrixXd* m : {&basis_, &excess_, &last_, &layered_}) m->resize(size, most);
  Eigen::Index kept = 0;
  std::erase_if(pairs_, [&](const Pair& p) {
    Eigen::VectorXd q = p.force, d = p.excess, t = p.last, l = p.layered;
    const double before = q.norm();
    for (int twice = 0; twice < 2; ++twice) {  // Gram and Schmidt, again for orthogonality to rounding
      const Eigen::VectorXd share = basis_.leftCols(kept).transpose() * q;
      q -= basis_.leftCols(kept) * share;
      d -= excess_.leftCols(kept) * share;
      t -= last_.leftCols(kept) * share;
      l -= layered_.leftCols(kept) * share;
    }
    const double rest = q.norm();
    if (!(rest >= kLeastNew * before)) return true;
    basis_.col(kept) = q / rest;
    excess_.col(kept) = d / rest;
    last_.col(kept) = t / rest;
    layered_.col(kept++) = l / rest;
    return false;
  });
  for (Eigen::MatrixXd* m : {&basis_, &excess_, &last_, &layered_})
    m->conservativeResize(Eigen::NoChange, kept);
  // Q^T D is symmetric but for what the pairs are off by. Of two entries the one with the newer pair's forces
  // and the older one's excess is taken: S' is then exact for the newest pair whatever the older ones are.
  core_ = excess_.transpose() * basis_;
  core_.triangularView<Eigen::StrictlyUpper>() = core_.transpose();
  gram_ = basis_.transpose() * layered_;
  found_ = 0;
  for (const Pair& p : pairs_) found_ = std::max(found_, p.share);
}

Eigen::MatrixXd RecycledCompliance::among(const std::vector<std::size_t>& unknowns) const {
  Eigen::MatrixXd s = scale_ * wide_.among(unknowns, grid_.nx, grid_.nz);
  if (pairs_.empty()) return s;
  const auto at = places(unknowns);
  const Eigen::MatrixXd q = basis_(at, Eigen::all), d = excess_(at, Eigen::all);
  const Eigen::MatrixXd half = (d - q * core_ / 2) * q.transpose();
  return s + half + half.transpose();
}

Eigen::VectorXd RecycledCompliance::wider_m(const std::vector<std::size_t>& unknowns,
                                            const Eigen::VectorXd& force_n) const {
  return scale_ *
         ((wide_.among(unknowns, grid_.nx, grid_.nz) - periodic_.among(unknowns, grid_.nx, grid_.nz)) *
          force_n);
}

Eigen::VectorXd RecycledCompliance::error_between(const std::vector<std::size_t>& unknowns,
                                                  const Eigen::MatrixXd& a, const Eigen::VectorXd& b) const {
  const Eigen::MatrixXd s = scale_ * periodic_.among(unknowns, grid_.nx, grid_.nz);
  Eigen::VectorXd error(a.cols());
  if (pairs_.empty()) {
    for (Eigen::Index c = 0; c < a.cols(); ++c)
      error[c] = largest_ * std::sqrt(a.col(c).dot(s * a.col(c)) * b.dot(s * b));
    return error;
  }
  const auto at = places(unknowns);
  const Eigen::MatrixXd q = basis_(at, Eigen::all), l = layered_(at, Eigen::all), t = last_(at, Eigen::all);
  const auto beyond = [&](const Eigen::VectorXd& v) {  // the pairs: its norm by S0
    const Eigen::VectorXd share = q.transpose() * v;
    return std::sqrt(
        std::max(0.0, v.dot(s * v) - 2 * share.dot(l.transpose() * v) + share.dot(gram_ * share)));
  };
  const double right = beyond(b);
  // What was learned elsewhere says little of a patch that is mostly new: there the bound holds.
  const bool elsewhere = right * right > kMostlyNew * b.dot(s * b);
  const double found = elsewhere ? largest_ : std::min(largest_, kBeyond * found_);
  const Eigen::VectorXd last = t * (q.transpose() * b);
  for (Eigen::Index c = 0; c < a.cols(); ++c)
    error[c] = found * beyond(a.col(c)) * right + std::abs(a.col(c).dot(last));
  return error;
}

}  // namespace teletact::service
