// How well log E is known at the least of the objective (T3.5): Laplace's approximation with the Gauss-Newton
// matrix, (N^-1 + J^T J)^-1, N^-1 = alpha L + prior with the lagged L, which says where the edges are. An
// element's modulus moves the displacement far around it, so that the data tell patches of elements apart and
// little within one: J^T J = Q^T M Q + D, Q the means over patches, D diagonal. Then, with N^-1 + D for N^-1
// and T = Q N Q^T,
//   C = N - N Q^T (1 + M T)^-1 M Q N,
// of which the diagonal is wanted: N's from its factor, the rest from one solve a patch.
//   Published is log E - log(a P[E]), scaled by the sensor's force, or log E less its mean.
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/problem.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;
using Matrix = StripModel::NodeColumns;

constexpr std::size_t kPatch = 4;   // elements a side under the probe
constexpr double kBesideM = 0.016;  // patches go on so far beside it
// The data's weight within a patch, over that of an element's own shortening: with it the deviations are
// 1 to 1.06 of those of the whole matrix, at 1 and 3 % of strain, 0.4 and 1.2 um of noise; without 1.04
// to 1.18.
constexpr double kWithin = 0.02;
constexpr double kMinTexture = 0.35;  // variance of the tissue over the prior's, which is the most

struct Patches {
  StripModel::Groups of_element;    // -1: none
  std::vector<double> sizes;        // elements
  std::vector<std::uint8_t> under;  // the probe
  Index rows = 0;                   // of patches: column by column
  Index count() const { return static_cast<Index>(sizes.size()); }
  template <class Work>  // (element, patch, its size)
  void each(Work work) const {
    for (std::size_t e = 0; e < of_element.size(); ++e)
      if (const int k = of_element[e]; k >= 0)
        work(static_cast<Index>(e), static_cast<Index>(k), sizes[static_cast<std::size_t>(k)]);
  }
  // The texture's variance over the prior's, t of T3.5: from differences of the means found in neighbouring
  // patches, over those that the prior and the data would bring (variances `expected`); the median, which
  // lumps leave.
  double variation(const VectorXd& found, const Eigen::MatrixXd& expected) const {
    constexpr double kMedianOfSquare = 0.455;
    std::vector<double> ratios;
    for (Index a = 0; a < count(); ++a)
      for (const Index b : {a + 1, a + rows}) {
        if (b >= count() || (b == a + 1 && b % rows == 0)) continue;
        if (!under[static_cast<std::size_t>(a)] || !under[static_cast<std::size_t>(b)]) continue;
        const double apart = found[a] - found[b];
        ratios.push_back(apart * apart / (expected(a, a) + expected(b, b) - 2 * expected(a, b)));
      }
    return std::clamp(median(ratios) / kMedianOfSquare, kMinTexture, 1.0);
  }
  Eigen::MatrixXd mean(const auto& of) const {  // Q
    Eigen::MatrixXd out = Eigen::MatrixXd::Zero(count(), of.cols());
    each([&](Index e, Index k, double size) { out.row(k) += of.row(e) / size; });
    return out;
  }
};

Patches patches_of(const StripModel& model) {
  const TissueGrid& g = model.grid();
  const std::size_t columns = g.nx() - 1, rows = g.ny() - 1;
  Patches out;
  out.of_element.assign(g.elements(), -1);
  out.rows = static_cast<Index>((rows + kPatch - 1) / kPatch);
  const double left = g.x_m[model.first_column()], right = g.x_m[model.last_column()];
  std::size_t begin = 0;
  while (g.x_m[begin + 1] <= left - kBesideM) ++begin;
  for (std::size_t end; begin < columns && g.x_m[begin] < right + kBesideM; begin = end) {
    const bool under = begin >= model.first_column() && begin < model.last_column();
    const std::size_t border = begin < model.first_column() ? model.first_column()
                               : under                      ? model.last_column()
                                                            : columns;
    end = std::min(begin + kPatch, border);
    for (std::size_t j = 0; j < rows; ++j) {
      if (j % kPatch == 0) {
        out.sizes.resize(out.sizes.size() + 1, 0.0);
        out.under.push_back(under);
      }
      for (std::size_t i = begin; i < end; ++i)
        out.of_element[g.element(i, j)] = static_cast<int>(out.sizes.size()) - 1, ++out.sizes.back();
    }
  }
  return out;
}

// Mean of exp(-r / length) over two points of a square of side 1.
double mean_correlation(double length) {
  constexpr int kSteps = 8;
  double sum = 0;
  for (int a = -kSteps + 1; a < kSteps; ++a)
    for (int b = -kSteps + 1; b < kSteps; ++b)
      sum += (kSteps - std::abs(a)) * (kSteps - std::abs(b)) * std::exp(-std::hypot(a, b) / kSteps / length);
  return sum / std::pow(kSteps, 4);
}

// The length over the patch's side with which a mean over a patch has `share` of an element's variance.
double correlation_length(double share) {
  double low = 0.02, high = 50;
  while (high > 1.01 * low) {
    const double middle = std::sqrt(low * high);
    (mean_correlation(middle) < share ? low : high) = middle;
  }
  return std::sqrt(low * high);
}

}  // namespace

ModulusPosterior ModulusProblem::posterior(const Point& p, bool absolute) {
  const std::vector<double> e = modulus(p.theta);
  const Patches patches = patches_of(model_);
  const Index count = patches.count(), elements = p.theta.size();
  DisplacementData::Products seen =
      data_.products(p.fit, model_.axial_changes(p.response, e, patches.of_element, static_cast<int>(count)));
  // Within a patch alike, so that D tells means over it D times its size.
  const std::vector<double> own = data_.weight_of_elements(model_.grid(), p.fit, p.response.displacement);
  const VectorXd within = kWithin * patches.mean(Eigen::Map<const VectorXd>(own.data(), elements)).col(0);
  Eigen::SparseMatrix<double> known = kTvPerM * variation_.lagged(p.theta);
  known.diagonal() += prior_weight_;
  patches.each([&](Index element, Index k, double) {
    known.diagonal()[element] += within[k];
    seen.of_changes(k, k) -= within[k];
  });
  if (!preconditioner_.analyzed())
    preconditioner_.analyze(known, nested_dissection(model_.grid().nx() - 1, model_.grid().ny() - 1));
  if (!preconditioner_.factorize(known))
    throw std::domain_error("the prior of the modulus is not positive definite");
  constexpr Index kAtOnce = SparseFactor::Columns::ColsAtCompileTime;
  Matrix spread(elements, count);  // N Q^T
  for (Index first = 0; first < count; first += kAtOnce) {
    SparseFactor::Columns unit = SparseFactor::Columns::Zero(elements, kAtOnce);
    patches.each([&](Index element, Index k, double size) {
      if (k >= first && k < first + kAtOnce) unit(element, k - first) = 1 / size;
    });
    const Index at_once = std::min(kAtOnce, count - first);
    spread.middleCols(first, at_once) = preconditioner_.solve_columns(unit).leftCols(at_once);
  }
  const Eigen::MatrixXd t = patches.mean(spread), &m = seen.of_changes;
  check_cancelled();
  const auto weighed = [&](double texture) -> Eigen::MatrixXd {
    return (Eigen::MatrixXd::Identity(count, count) + texture * m * t).partialPivLu().solve(texture * m);
  };
  const double texture = patches.variation(patches.mean(p.theta - prior_), t * weighed(1) * t);
  check_cancelled();
  const Eigen::MatrixXd x = weighed(texture);
  check_cancelled();
  Eigen::MatrixXd half = x;  // N Q^T X Q N is twice the symmetric part of N Q^T half Q N
  half.diagonal() *= 0.5;
  const Matrix told = spread * half.triangularView<Eigen::Lower>();
  check_cancelled();
  // The map's scale: d log(a P) / d log E, or the mean under the probe.
  VectorXd scale = VectorXd::Zero(elements);
  const double under = std::accumulate(patches.under.begin(), patches.under.end(), 0.0);
  if (absolute) {
    const std::vector<double> shares = model_.force_shares(p.response, e);
    scale = Eigen::Map<const VectorXd>(shares.data(), elements);
  }
  patches.each([&](Index element, Index k, double size) {
    if (absolute)
      scale[element] += seen.log_amplitude[k] / size;
    else if (patches.under[static_cast<std::size_t>(k)])
      scale[element] = 1 / (under * size);
  });
  const VectorXd of_scale = preconditioner_.solve(scale);
  const VectorXd with_scale = of_scale - spread * (x * patches.mean(of_scale));  // covariance
  const double alone = scale.dot(with_scale);
  const VectorXd variance =
      (preconditioner_.inverse_diagonal() - 2 * (told.cwiseProduct(spread).rowwise().sum() + with_scale))
          .array() +
      alone;
  // Variance of the mean over each patch, over the mean of its elements'.
  const VectorXd of_means = (t - t * x * t).diagonal() - 2 * patches.mean(with_scale),
                 of_elements = patches.mean(variance);
  std::vector<double> ratios;
  for (Index k = 0; k < count; ++k)
    if (patches.under[static_cast<std::size_t>(k)]) ratios.push_back((of_means[k] + alone) / of_elements[k]);
  const double side_m = kPatch * (model_.grid().y_m[1] - model_.grid().y_m[0]);
  return {(texture * variance).cwiseMax(0).cwiseSqrt(), side_m * correlation_length(median(ratios)), texture};
}

}  // namespace teletact::service
