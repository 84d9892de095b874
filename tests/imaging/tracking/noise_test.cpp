// Noise statistics, the filter made from them, and how noise passes through the estimators.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "service/imaging/tracking/noise_model.h"

namespace teletact::service {
namespace {

// Speckle of 0.18 cycles a sample, envelope `width` samples, beam `beam` lines; noise: part that is white and
// part that looks like speckle.
Autocorrelations statistics(double white, double speckle_like) {
  Autocorrelations a{32, 8, {}, {}};
  for (int q = 0; q < a.laterals; ++q)
    for (int k = 0; k < a.lags; ++k) {
      const double echo = std::exp(-k * k / 80.0 - q * q / 1.8) * std::cos(2 * std::numbers::pi * 0.18 * k);
      const double noise = (k == 0 && q == 0 ? white : 0) + speckle_like * echo;
      a.mean.push_back(echo + noise / 2);
      a.difference.push_back(2 * noise);
    }
  return a;
}

TEST(NoiseModel, WhiteNoiseIsNotSpread) {
  const NoiseModel model = noise_model(statistics(0.01, 0));
  EXPECT_NEAR(model.spread[0], 1, 1e-9);
  EXPECT_NEAR(model.spread[1], 1, 1e-9);
}

// The sum of squared correlations of the speckle: sqrt(80 pi / 2) / 2 axially for the carrier, sqrt(1.8 pi /
// 2) across.
TEST(NoiseModel, DecorrelationIsSpreadLikeTheSpeckle) {
  const NoiseModel model = noise_model(statistics(0, 0.01));
  const double axial = std::sqrt(80 * std::numbers::pi / 2) / 2,
               lateral = std::sqrt(1.8 * std::numbers::pi / 2);
  EXPECT_NEAR(model.spread[1], axial * lateral, 0.05 * axial * lateral);
  EXPECT_NEAR(model.sensitivity[1], 1 / 1.005, 1e-6);
}

double gain(const std::vector<float>& taps, double frequency) {
  double sum = taps[0];
  for (std::size_t k = 1; k < taps.size(); ++k)
    sum += 2 * taps[k] * std::cos(2 * std::numbers::pi * frequency * static_cast<double>(k));
  return sum;
}

TEST(MatchedFilter, PassesTheBandAndWhitensDecorrelation) {
  const MatchedFilter white = matched_filter(statistics(0.02, 0), 16, 4),
                      like = matched_filter(statistics(0.002, 0.05), 16, 4);
  EXPECT_NEAR(gain(white.axial, 0.18), 1, 0.05);
  EXPECT_NEAR(gain(white.axial, 0.20), 1, 0.15);
  for (const double silent : {0.0, 0.4, 0.5}) EXPECT_LE(std::abs(gain(white.axial, silent)), 0.3) << silent;
  // Towards the band's edge noise that looks like speckle is as weak as the speckle: worth amplifying.
  EXPECT_GE(gain(like.axial, 0.22) / gain(like.axial, 0.18),
            1.5 * gain(white.axial, 0.22) / gain(white.axial, 0.18));
  EXPECT_LE(std::abs(gain(like.axial, 0.45)), 0.05);  // the interpolation fails there
}

// The exact response of the centre of a 25 x 25 grid, by matrices.
double exact_deviation(const SmootherResponse& s, double h, int line_step, int sample_step) {
  constexpr int kSide = 25, kNodes = kSide * kSide;
  const auto hats = [](int step) {  // overlap of a hat with itself and with its neighbour
    double own = 0, next = 0;
    for (int n = -step; n <= step; ++n) {
      const double hat = 1 - std::abs(n) / double(step);
      own += hat * hat / step, next += n >= 0 ? hat * (1 - hat) / step : 0;
    }
    return std::pair{own, next};
  };
  const auto [own_x, next_x] = hats(line_step);
  const auto [own_y, next_y] = hats(sample_step);
  Eigen::MatrixXd mass = Eigen::MatrixXd::Zero(kNodes, kNodes), stiff = mass, pull = mass;
  const auto at = [](int i, int j) {
    return (i + kSide) % kSide + kSide * ((j + kSide) % kSide);
  };  // periodic
  for (int j = 0; j < kSide; ++j)
    for (int i = 0; i < kSide; ++i) {
      const int n = at(i, j), r = s.gradient_radius;
      for (int dj = -1; dj <= 1; ++dj)
        for (int di = -1; di <= 1; ++di)
          mass(n, at(i + di, j + dj)) += h * (di ? next_x : own_x) * (dj ? next_y : own_y);
      // sum over the edges of w (D v)^2, and w D^T of the mean of both ends' gradients
      for (const auto& [di, dj, w] : {std::tuple{1, 0, s.weight_along}, {0, 1, s.weight_down}}) {
        const int m = at(i + di, j + dj);
        stiff(n, n) += w, stiff(m, m) += w, stiff(n, m) -= w, stiff(m, n) -= w;
        for (const int end : {0, 1})
          for (int k = -r; k <= r; ++k) {
            const int ci = i + end * di, cj = j + end * dj;
            const double part = 0.5 * w / (2 * r) / (2 * r + 1);
            const int far = at(ci + (di ? r : k), cj + (dj ? r : k)),
                      near = at(ci - (di ? r : -k), cj - (dj ? r : -k));
            pull(m, far) += part, pull(m, near) -= part, pull(n, far) -= part, pull(n, near) += part;
          }
      }
    }
  const Eigen::MatrixXd inverse = (h * Eigen::MatrixXd::Identity(kNodes, kNodes) + stiff)
                                      .ldlt()
                                      .solve(Eigen::MatrixXd::Identity(kNodes, kNodes));
  // u <- u + inverse (score noise - mass u - (stiff - pull) u); the score noise has the covariance mass.
  Eigen::MatrixXd response = Eigen::MatrixXd::Zero(kNodes, kNodes);
  for (int step = 0; step < s.steps; ++step)
    response += inverse * (Eigen::MatrixXd::Identity(kNodes, kNodes) - (mass + stiff - pull) * response);
  return std::sqrt((response.row(0) * mass * response.row(0).transpose())(0, 0));
}

TEST(NoiseResponse, DeviationOfTheSmootherIsThatOfTheMatrices) {
  const SmootherResponse smoother{3.0, 4.5, 3, 2};
  const NoiseResponse response(smoother, 1.3, 2, 21);
  const double got = response.deviation()[kBelowMedian];
  EXPECT_NEAR(got, exact_deviation(smoother, 1.3, 2, 21), 0.02 * got);
}

// Averaging and the smoothing itself hide part of the bias that the edges show; without edges there is none.
TEST(NoiseResponse, WhatIsSeenOfTheSmoothingsBiasIsLessThanItIs) {
  constexpr int kMiddle = kBelowMedian;
  const NoiseResponse response(SmootherResponse{3.0, 4.5, 3, 3}, 1.3, 2, 21);
  const float near = response.bias_over_seen(1)[kMiddle], wide = response.bias_over_seen(2)[kMiddle];
  EXPECT_GT(near, 1);
  EXPECT_LT(near, 4);
  EXPECT_GT(wide, near);
  EXPECT_GT(response.bias_noise(1)[kMiddle], response.bias_noise(2)[kMiddle]);
  EXPECT_GT(response.bias_noise(2)[kMiddle], 0);
  const NoiseResponse plain(SmootherResponse{0, 0, 3, 3}, 2.0, 1, 1);
  EXPECT_EQ(plain.bias_noise(1)[kMiddle], 0);
  EXPECT_EQ(plain.bias_over_seen(1)[kMiddle], 0);
}

// The slope of a least-squares line through independent nodes: variance / (sum of squares x columns).
TEST(NoiseResponse, SlopeOfIndependentNodesIsTextbook) {
  const NoiseResponse response(SmootherResponse{0, 0, 3, 1}, 2.0, 1, 1);
  const double got = response.slope(1, 3, false)[kBelowMedian];
  EXPECT_NEAR(got, std::sqrt(0.5 / (28.0 * 3)), 1e-3 * got);
}

}  // namespace
}  // namespace teletact::service
