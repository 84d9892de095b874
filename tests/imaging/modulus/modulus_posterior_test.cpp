// What is stated of the iterative modulus (T3.5) against the whole matrix, inverted, of a small strip.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "service/imaging/modulus/problem.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kWidthM = 0.020, kDepthM = 0.016, kBackgroundPa = 8e3, kIndependentM2 = 1.9e-6;
const ImageGrid kImage{38, 36, 0.3e-3, 0.2e-3, 0.52e-3, 0.43e-3};

// Of a lump in tissue with wrinkles of so much log E: less of them than the prior expects narrow it.
class Posterior : public ::testing::TestWithParam<double> {
 protected:
  Posterior()
      : model({0.070, kDepthM, 0.025}, kWidthM), elements(static_cast<Index>(model.grid().elements())) {
    const TissueGrid& g = model.grid();
    theta.resize(elements);
    for (Index e = 0; e < elements; ++e) {  // a stiff lump with a soft rim
      const auto i = static_cast<std::size_t>(e) % (g.nx() - 1),
                 j = static_cast<std::size_t>(e) / (g.nx() - 1);
      const double off_m = std::hypot(g.x_m[i] - 0.009, g.y_m[j] - 0.007);
      theta[e] = 12 * GetParam() / (1 + std::exp((off_m - 0.003) / 0.5e-3)) +
                 GetParam() * std::sin(0.9 * static_cast<double>(e));
    }
    measured.grid = kImage;
    for (std::size_t n = 0; n < kImage.size(); ++n) {
      measured.axial_displacement.push_back(static_cast<float>(160e-6 * (1 - kImage.y_m(n) / kDepthM)));
      measured.displacement_valid.push_back(n % 11 != 3);
      measured.axial_displacement_std.push_back(static_cast<float>(1e-6 * (1 + 0.3 * std::cos(double(n)))));
    }
  }
  DisplacementData data() { return {model, measured, 0, kIndependentM2}; }
  ModulusProblem problem() { return {model, data(), VectorXd::Zero(elements), kBackgroundPa}; }
  bool under(Index e) const {
    const auto i = static_cast<std::size_t>(e) % (model.grid().nx() - 1);
    return i >= model.first_column() && i < model.last_column();
  }
  StripModel model;
  Index elements;
  VectorXd theta;
  Measured measured;
};

// The covariance of log E as it is published: less d log(a P) of a change of log E, or less its mean.
MatrixXd published(const MatrixXd& c, const VectorXd& scale) {
  const MatrixXd from = MatrixXd::Identity(c.rows(), c.cols()) - VectorXd::Ones(c.rows()) * scale.transpose();
  return from * c * from.transpose();
}

TEST_P(Posterior, IsThatOfTheWholeMatrix) {
  ModulusProblem product = problem();
  const DisplacementData all = data();
  const ModulusProblem::Point point = product.at(theta);
  const std::vector<double> modulus = product.modulus(theta);
  MatrixXd j;
  VectorXd scale(elements);
  for (Index e = 0; e < elements; ++e) {
    std::vector<double> change(modulus.size());
    change[static_cast<std::size_t>(e)] = modulus[static_cast<std::size_t>(e)];
    const std::vector<double> column = all.change(point.fit, model.change(point.response, change));
    if (e == 0) j.resize(static_cast<Index>(column.size()), elements);
    j.col(e) = Eigen::Map<const VectorXd>(column.data(), j.rows());
  }
  const double texture = product.posterior(point, true).texture;
  MatrixXd h = kTvPerM * TotalVariation(model.grid()).lagged(theta);
  h.diagonal() += prior_weight(model);
  EXPECT_EQ(texture == 1, GetParam() > 0.05) << texture;
  h = j.transpose() * j + h / texture;
  const MatrixXd covariance = h.llt().solve(MatrixXd::Identity(elements, elements));
  const auto log_scale = [&](const VectorXd& at) {  // of the modelled force, a as fitted to modelled data
    const StripResponse r = model.solve(product.modulus(at));
    return std::log(r.force_n_per_m);
  };
  const double step = 1e-4, here = log_scale(theta);
  for (Index e = 0; e < elements; ++e) {
    VectorXd moved = theta;
    moved[e] += step;
    scale[e] = (log_scale(moved) - here) / step;
  }
  product.at(theta);
  EXPECT_NEAR(scale.sum(), 1, 1e-3);
  const std::vector<double> shares = model.force_shares(point.response, modulus);
  EXPECT_LE((Eigen::Map<const VectorXd>(shares.data(), elements) - scale).cwiseAbs().maxCoeff(), 1e-4);
  // Of the amplitude: of a model that was fitted without residual.
  StripModel::Groups each(static_cast<std::size_t>(elements));
  for (std::size_t e = 0; e < each.size(); ++e) each[e] = static_cast<int>(e);
  const StripModel::NodeColumns moved =
      model.axial_changes(point.response, modulus, each, static_cast<int>(elements));
  const DisplacementData::Products seen = all.products(point.fit, moved);
  EXPECT_LE((seen.of_changes - j.transpose() * j).norm(), 1e-9 * seen.of_changes.norm());
  std::vector<double> displaced = point.response.displacement;
  for (std::size_t n = 0; n < model.grid().nodes(); ++n)
    displaced[2 * n + 1] += 1e-3 * moved(static_cast<Index>(n), 7);
  Measured exact = measured;
  for (std::size_t n = 0, k = 0; n < kImage.size(); ++n)
    if (measured.displacement_valid[n])
      exact.axial_displacement[n] = static_cast<float>(1e-4 * point.fit.modelled[k++]);
  const DisplacementData without(model, exact, 0, kIndependentM2);
  EXPECT_NEAR(std::log(without.fit(displaced).amplitude / without.fit(point.response.displacement).amplitude),
              1e-3 * seen.log_amplitude[7], 2e-2 * std::abs(1e-3 * seen.log_amplitude[7]));
  scale += seen.log_amplitude;
  VectorXd of_mean(elements);
  for (Index e = 0; e < elements; ++e) of_mean[e] = under(e);
  of_mean /= of_mean.sum();
  for (const bool absolute : {true, false}) {
    const MatrixXd want = published(covariance, absolute ? scale : of_mean);
    const ModulusPosterior got = product.posterior(point, absolute);
    std::vector<double> ratios;
    for (Index e = 0; e < elements; ++e)
      if (under(e)) ratios.push_back(got.deviation[e] / std::sqrt(want(e, e)));
    EXPECT_NEAR(median(ratios), 1.04, 0.06) << absolute;
    EXPECT_GE(*std::min_element(ratios.begin(), ratios.end()), 0.85) << absolute;
    EXPECT_LE(*std::max_element(ratios.begin(), ratios.end()), 1.35) << absolute;
    // Means over 5 mm, with the correlation that is stated.
    const std::size_t columns = model.grid().nx() - 1, first = model.first_column();
    std::vector<double> of_means;
    for (std::size_t corner : {first + columns, first + 9 + 2 * columns, first + 14 + 8 * columns}) {
      double true_variance = 0, stated = 0;
      for (std::size_t a = 0; a < 25; ++a)
        for (std::size_t b = 0; b < 25; ++b) {
          const Index p = static_cast<Index>(corner + a % 5 + columns * (a / 5)),
                      q = static_cast<Index>(corner + b % 5 + columns * (b / 5));
          const double apart_m =
              1e-3 * std::hypot(double(a % 5) - double(b % 5), double(a / 5) - double(b / 5));
          true_variance += want(p, q);
          stated += got.deviation[p] * got.deviation[q] * std::exp(-apart_m / got.correlation_m);
        }
      of_means.push_back(std::sqrt(stated / true_variance));
      EXPECT_GE(of_means.back(), 0.6) << absolute;
      EXPECT_LE(of_means.back(), 2) << absolute;
    }
    std::printf(
        "%s: %.2f (%.2f to %.2f) of the whole matrix's deviations; means of 5 mm %.2f %.2f %.2f; %.1f mm, "
        "texture %.2f\n",
        absolute ? "absolute" : "relative", median(ratios), *std::min_element(ratios.begin(), ratios.end()),
        *std::max_element(ratios.begin(), ratios.end()), of_means[0], of_means[1], of_means[2],
        1e3 * got.correlation_m, texture);
  }
}

INSTANTIATE_TEST_SUITE_P(Wrinkles, Posterior, ::testing::Values(0.1, 0.01));

}  // namespace
}  // namespace teletact::service
