#include "service/contact/layered_touch.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <stdexcept>
#include <utility>

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Radii of contacts in the table, each so much wider than the one before, up to this share of a sphere's;
// of a paraboloid so many times its radius of curvature.
constexpr double kMinRadius = 1e-4, kWider = 1.15, kWidest = 0.97;
constexpr double kMaxRadius = 0.03, kOfParaboloid = 3;
// A contact is at most so many times as wide as the topmost layer is thick: points of its equation are added
// with that.
constexpr double kMaxOfTopLayer = 16;
constexpr Index kPoints = 32, kPointsOfTopLayer = 8;
// F grows with so high a power of d at least, and at most: rows beyond are not solved well.
constexpr double kMinPower = 1, kMaxPower = 4;
// Deeper than is known what was added to ln U fades to a constant within this share of what is known.
constexpr double kFades = 0.25;
// Waves shorter than this times the topmost layer's thickness do not feel what lies below it.
constexpr double kMaxWave = 18;
constexpr Index kPanel = 12;  // points of a panel of wave numbers

struct Quadrature {
  std::vector<double> at, weight;
};
// Gauss and Legendre's over [0, 1], by Newton's iteration from Tricomi's guess.
Quadrature gauss_legendre(Index n) {
  Quadrature q;
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
    q.at.push_back((1 + x) / 2);
    q.weight.push_back(1 / ((1 - x * x) * slope * slope));
  }
  return q;
}

// M - 1 of the stack, times its weight in an integral over all wave numbers; panels grow from the whole
// depth's to those that the widest contact's cosines ask for.
struct Waves {
  VectorXd at, share;
};
Waves waves_of(const LayerStack& stack, double widest_m) {
  const double depth_m = std::accumulate(stack.thickness_m.begin(), stack.thickness_m.end(), 0.0);
  const double last = kMaxWave / stack.thickness_m.front(), longest = 2 * std::numbers::pi / widest_m;
  const Quadrature panel = gauss_legendre(kPanel);
  std::vector<double> at, share;
  double begin = 0, length = 1 / depth_m;
  while (begin < last) {
    for (std::size_t n = 0; n < panel.at.size(); ++n) {
      at.push_back(begin + length * panel.at[n]);
      share.push_back(length * panel.weight[n] * (layered_kernel(stack, at.back()) - 1));
    }
    begin += length;
    length = std::min(1.5 * length, longest);
  }
  return {Eigen::Map<VectorXd>(at.data(), static_cast<Index>(at.size())),
          Eigen::Map<VectorXd>(share.data(), static_cast<Index>(share.size()))};
}

// Neighbours of the same modulus are one layer.
LayerStack merged(const LayerStack& stack) {
  LayerStack out{{}, {}, stack.poisson_ratio};
  for (std::size_t n = 0; n < stack.thickness_m.size(); ++n) {
    if (n > 0 && stack.youngs_modulus_pa[n] == out.youngs_modulus_pa.back()) {
      out.thickness_m.back() += stack.thickness_m[n];
      continue;
    }
    out.thickness_m.push_back(stack.thickness_m[n]);
    out.youngs_modulus_pa.push_back(stack.youngs_modulus_pa[n]);
  }
  return out;
}

}  // namespace

double LayeredTouch::Row::force_n() const {
  return std::exp(log_force);
}

// Cubic through two rows, of ln F over ln d, at share t of the way.
struct LayeredTouch::Between {
  Between(const Row& before, const Row& after)
      : before(before), after(after), width(after.log_indentation - before.log_indentation) {}
  double cubic(double t, double from, double to, double slope_from, double slope_to) const {
    const double u = 1 - t;
    return u * u * (1 + 2 * t) * from + t * t * (3 - 2 * t) * to +
           width * t * u * (u * slope_from - t * slope_to);
  }
  double force_n(double t) const {
    return std::exp(cubic(t, before.log_force, after.log_force, before.power, after.power));
  }
  double power(double t) const {
    const double u = 1 - t;
    return 6 * t * u / width * (after.log_force - before.log_force) + u * (1 - 3 * t) * before.power +
           t * (3 * t - 2) * after.power;
  }
  double radius_m(double t) const {
    return std::exp(cubic(t, before.log_radius, after.log_radius, before.radius_power, after.radius_power));
  }
  // From the row before.
  double work_j(double t) const {
    static const Quadrature parts = gauss_legendre(4);
    double sum = 0;
    for (std::size_t q = 0; q < parts.at.size(); ++q) {
      const double at = t * parts.at[q];
      sum += parts.weight[q] * force_n(at) * std::exp(before.log_indentation + width * at);
    }
    return width * t * sum;
  }
  const Row &before, &after;
  const double width;
};

// Pressure p of Hankel transform P(s) = E*/pi Int_0^a f(t) cos(s t) dt, E* that of the topmost layer, moves
// the surface as a tip does whose Abel transform is f(t) + 2/pi Int f(u) Int (M - 1) cos(s t) cos(s u) ds du:
// d - t^2 / R of a paraboloid, d - t artanh(t / R) of a sphere. It is borne up to where f(a) = 0.
LayeredTouch::LayeredTouch(const LayerStack& given, const Fingertip& tip) {
  if (!round_and_frictionless(tip))
    throw std::invalid_argument("layered touch: only for a frictionless rounded tip or sphere");
  const LayerStack stack = merged(given);
  const double nu = stack.poisson_ratio, plane_pa = stack.youngs_modulus_pa.front() / (1 - nu * nu);
  const bool sphere = tip.shape == FingertipShape::kSphere;
  const double widest = std::min({kMaxRadius, (sphere ? kWidest : kOfParaboloid) * tip.radius_m,
                                  kMaxOfTopLayer * stack.thickness_m.front()});
  const Waves waves = waves_of(stack, widest);
  const auto rise = [&](double t) {
    return sphere ? t * std::atanh(t / tip.radius_m) : t * t / tip.radius_m;
  };
  const double least = std::min(kMinRadius, widest / 4);
  const auto rows = static_cast<int>(std::log(widest / least) / std::log(kWider));
  for (int n = 0; n <= rows; ++n) {
    const double a = least * std::pow(kWider, n);
    const Index points = kPoints + kPointsOfTopLayer * std::lround(a / stack.thickness_m.front());
    const Quadrature contact = gauss_legendre(points);
    const Eigen::Map<const VectorXd> point(contact.at.data(), points), weight(contact.weight.data(), points);
    const MatrixXd cosines = (a * waves.at * point.transpose()).array().cos();
    const MatrixXd weighted = (2 * a / std::numbers::pi * waves.share).asDiagonal() * cosines;
    MatrixXd equation = (cosines.transpose() * weighted) * weight.asDiagonal();
    equation.diagonal().array() += 1;
    MatrixXd right(points, 2);
    right << VectorXd::Ones(points), (a * point).unaryExpr(rise);
    const MatrixXd f = equation.partialPivLu().solve(right);
    const Eigen::RowVector2d sum = a * weight.transpose() * f;
    const VectorXd edge = (weighted.transpose() * (a * waves.at).array().cos().matrix()).cwiseProduct(weight);
    const Eigen::RowVector2d at_edge = Eigen::RowVector2d(1, rise(a)) - edge.transpose() * f;
    const double d = at_edge[1] / at_edge[0], force = 2 * plane_pa * (d * sum[0] - sum[1]);
    const Row row{d, std::log(d), std::log(force), 2 * plane_pa * sum[0] * d / force, std::log(a), 0, 0};
    const bool solved = d > 0 && force > 0 && row.power > kMinPower && row.power < kMaxPower &&
                        (rows_.empty() || (d > max_m() && row.log_force > rows_.back().log_force));
    if (!solved) break;
    rows_.push_back(row);
  }
  // Radii are as many times as wide each: ln d by ln a is their difference, by as many of them as there are.
  for (std::size_t n = 0; n < rows_.size(); ++n) {
    const std::size_t beside = std::min({n, rows_.size() - 1 - n, std::size_t{2}});
    const auto across = [&](std::size_t k) {
      return rows_[n + k].log_indentation - rows_[n - k].log_indentation;
    };
    const double step = std::log(kWider);
    rows_[n].radius_power = beside == 2   ? 12 * step / (8 * across(1) - across(2))
                            : beside == 1 ? 2 * step / across(1)
                            : n == 0      ? 0.5
                                          : rows_[n - 1].radius_power;
  }
  for (std::size_t n = 0; n < rows_.size(); ++n)
    rows_[n].energy_j = n == 0 ? rows_[0].force_n() * rows_[0].indentation_m / (rows_[0].power + 1)
                               : rows_[n - 1].energy_j + Between(rows_[n - 1], rows_[n]).work_j(1);
}

LayeredTouch::At LayeredTouch::at(double d) const {
  if (!(d > 0)) return {};
  if (rows_.empty() || d > max_m())
    throw std::out_of_range(fmt::format("layered touch: {} m deep, up to {} m are known", d, max_m()));
  if (rows_.size() == 1 && d == max_m())
    return {rows_[0].force_n(), rows_[0].power * rows_[0].force_n() / d, rows_[0].energy_j,
            std::exp(rows_[0].log_radius)};
  const auto above = std::ranges::upper_bound(rows_, d, {}, &Row::indentation_m);
  if (above == rows_.begin()) {  // of the topmost layer alone, about
    const Row& first = rows_.front();
    const double share = d / first.indentation_m, force = first.force_n() * std::pow(share, first.power);
    return {force, first.power * force / d, force * d / (first.power + 1),
            std::exp(first.log_radius) * std::sqrt(share)};
  }
  const auto after = above == rows_.end() ? above - 1 : above;
  const Between rows(*(after - 1), *after);
  const double t = (std::log(d) - rows.before.log_indentation) / rows.width, force = rows.force_n(t);
  return {force, rows.power(t) * force / d, rows.before.energy_j + rows.work_j(t), rows.radius_m(t)};
}

bool make_layers_exact(ContactAnswer& answer, const ContactAnswer& layered, const LayeredTouch::At& exact,
                       double beyond_m, double known_m) {
  if (answer.state != ContactState::kContact || !(layered.energy_j > 0) || !(answer.energy_j > 0))
    return false;
  using Three = Eigen::Vector3d;
  using Square = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  // Of ln U: its gradient, and its second derivatives.
  const auto slope = [](const ContactAnswer& a) -> Three { return -Three(a.force_n.data()) / a.energy_j; };
  const auto bend = [](const ContactAnswer& a, const Three& g) -> Square {
    return -Square(a.tangent_n_m.data()) / a.energy_j - g * g.transpose();
  };
  const Three of_nodes = slope(answer), of_layers = slope(layered);
  const double power = exact.force_n / exact.energy_j;
  double ratio = std::log(exact.energy_j / layered.energy_j);  // what is added to ln U
  Three by = -of_layers + Three(0, power, 0);
  Square twice = -bend(layered, of_layers);
  twice(1, 1) += exact.stiffness_n_m / exact.energy_j - power * power;
  if (beyond_m > 0) {  // it goes on with that slope, ever less
    const double length = kFades * known_m, left = std::exp(-beyond_m / length);
    ratio += by[1] * length * (1 - left);
    by[1] *= left;
    twice.row(1).setZero(), twice.col(1).setZero();
    twice(1, 1) = -by[1] / length;
  }
  const Three g = of_nodes + by;
  Square h = bend(answer, of_nodes) + twice;
  h += g * g.transpose();
  const double before_n = answer.force_n[1];
  answer.energy_j *= std::exp(ratio);
  for (std::size_t c = 0; c < 3; ++c) answer.force_n[c] = -answer.energy_j * g[static_cast<Index>(c)];
  Square::Map(answer.tangent_n_m.data()) = -answer.energy_j * (h + h.transpose()) / 2;
  answer.largest_strain *= answer.force_n[1] / before_n;
  answer.strain_beyond_linear = answer.largest_strain > kLargestLinearStrain;
  for (NodalPressure& p : answer.pressure) {
    p.pressure_pa *= answer.force_n[1] / before_n;
    for (double& t : p.traction_pa) t *= answer.force_n[1] / before_n;
  }
  return true;
}

}  // namespace teletact::service
