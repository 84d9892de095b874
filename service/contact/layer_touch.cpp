#include "service/contact/layer_touch.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <stdexcept>
#include <utility>

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Points of the equation over the contact's radius, and of its kernel over wave numbers up to kMostWave /
// depth: beyond, the layer is a half-space to 1e-15.
constexpr Index kPoints = 32, kWaves = 160;
constexpr double kMostWave = 22;
// Contact radius over depth, of the table's rows; four of them are interpolated.
constexpr double kStep = 0.03;
constexpr std::size_t kInterpolated = 4;

struct Quadrature {
  VectorXd at, weight;
};
// Gauss and Legendre's over [0, length], by Newton's iteration from Tricomi's guess.
Quadrature gauss_legendre(Index n, double length) {
  Quadrature q{VectorXd(n), VectorXd(n)};
  for (Index k = 0; k < n; ++k) {
    double x = std::cos(std::numbers::pi * (static_cast<double>(k) + 0.75) / (static_cast<double>(n) + 0.5));
    double slope = 1;
    for (int tries = 0; tries < 5; ++tries) {
      double before = 1, p = x;
      for (Index m = 2; m <= n; ++m) {
        const auto order = static_cast<double>(m);
        before = std::exchange(p, ((2 * order - 1) * x * p - (order - 1) * before) / order);
      }
      slope = static_cast<double>(n) * (before - x * p) / (1 - x * x);
      x -= p / slope;
    }
    q.at[k] = length * (1 + x) / 2;
    q.weight[k] = length / ((1 - x * x) * slope * slope);
  }
  return q;
}

// 1 - M: how much less a layer moves than a half-space at wave number s / depth.
double held_back(double s, double poisson_ratio) {
  const double k = 3 - 4 * poisson_ratio, far = std::exp(-2 * s);
  return 1 - (k * (1 - far * far) - 4 * s * far) / (k * (1 + far * far) + (4 * s * s + 1 + k * k) * far);
}

double hertz_n(double plane_modulus_pa, double radius_m, double indentation_m) {
  return 4.0 / 3 * plane_modulus_pa * std::sqrt(radius_m * indentation_m) * indentation_m;
}

void require(bool holds, const char* what, double value) {
  if (!holds || !std::isfinite(value))
    throw std::invalid_argument(fmt::format("layer touch: {} {} is not usable", what, value));
}

}  // namespace

LayerTouch::LayerTouch(double poisson_ratio) : poisson_ratio_(poisson_ratio) {
  require(poisson_ratio >= 0 && poisson_ratio < 0.5, "poisson ratio", poisson_ratio);
  const Quadrature contact = gauss_legendre(kPoints, 1), waves = gauss_legendre(kWaves, kMostWave);
  const VectorXd share =
      waves.weight.cwiseProduct(waves.at.unaryExpr([&](double s) { return held_back(s, poisson_ratio); }));
  rows_.push_back({0, 0, 1.5, 1});
  for (int n = 1; rows_.back().ratio < kMostRatio; ++n) {
    // In units of the contact's radius a: f(x) - Int_0^1 K(x, t) f(t) dt = 1, and = x^2,
    // K(x, t) = 2 a / pi Int_0^inf (1 - M(s)) cos(s a x) cos(s a t) ds.
    const double a = kStep * n;  // over the depth
    const MatrixXd cosines = (a * waves.at * contact.at.transpose()).array().cos();
    const MatrixXd weighted = (2 * a / std::numbers::pi * share).asDiagonal() * cosines;
    MatrixXd equation = -(cosines.transpose() * weighted) * contact.weight.asDiagonal();
    equation.diagonal().array() += 1;
    MatrixXd right(kPoints, 2);
    right << VectorXd::Ones(kPoints), contact.at.cwiseAbs2();
    const MatrixXd f = equation.partialPivLu().solve(right);
    const Eigen::RowVector2d sum = contact.weight.transpose() * f;
    const VectorXd edge = weighted.transpose() * (a * waves.at).array().cos().matrix();
    const Eigen::RowVector2d at_edge =
        Eigen::RowVector2d::Ones() + edge.cwiseProduct(contact.weight).transpose() * f;
    // No pressure at the edge: the indentation over a^2 / radius.
    const double depth = at_edge[1] / at_edge[0];
    const double force = depth * sum[0] - sum[1];  // over 2 E* a^3 / radius
    const double root = std::sqrt(depth);
    rows_.push_back({a * root, std::log(1.5 * force / (depth * root)), depth * sum[0] / force, 1 / root});
  }
}

LayerForce LayerTouch::touch(double youngs_modulus_pa, double depth_m, double radius_m,
                             double indentation_m) const {
  require(youngs_modulus_pa > 0, "modulus", youngs_modulus_pa);
  require(depth_m > 0, "depth", depth_m);
  require(radius_m > 0, "radius", radius_m);
  require(true, "indentation", indentation_m);
  if (indentation_m <= 0) return {};
  const double hertz_m = std::sqrt(radius_m * indentation_m), ratio = hertz_m / depth_m;
  if (!(ratio <= kMostRatio))
    throw std::out_of_range(
        fmt::format("layer touch: {} m deep is too deep for a tip of {} m on a layer of {} m", indentation_m,
                    radius_m, depth_m));
  const auto above =
      static_cast<std::size_t>(std::ranges::upper_bound(rows_, ratio, {}, &Row::ratio) - rows_.begin());
  const std::size_t first = std::clamp<std::size_t>(above, 2, rows_.size() - 2) - 2;
  Row at{ratio, 0, 0, 0};
  for (std::size_t i = first; i < first + kInterpolated; ++i) {
    double weight = 1;  // Lagrange's
    for (std::size_t j = first; j < first + kInterpolated; ++j)
      if (j != i) weight *= (ratio - rows_[j].ratio) / (rows_[i].ratio - rows_[j].ratio);
    at.ln_force += weight * rows_[i].ln_force;
    at.power += weight * rows_[i].power;
    at.radius += weight * rows_[i].radius;
  }
  const double plane_modulus_pa = youngs_modulus_pa / (1 - poisson_ratio_ * poisson_ratio_);
  const double force_n = hertz_n(plane_modulus_pa, radius_m, indentation_m) * std::exp(at.ln_force);
  return {force_n, at.power * force_n / indentation_m, at.radius * hertz_m};
}

}  // namespace teletact::service
