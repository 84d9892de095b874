#include "service/contact/shares_touch.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "service/contact/solid_answer.h"

namespace teletact::service {
namespace {

// What log-weighted shares are off by, over the variance of ln(E / E0) in what is felt, and beside that:
// within twice this in 95 of 100 (bench plan).
constexpr double kOfVariance = 0.25, kOfShares = 0.0015;
// How deep they answer; a table of layers that ends above the first is of no use.
constexpr double kShallowest = 0.0003, kDeepest = 0.010;
// Gauss and Legendre's over [0, 1]; depths are d t^2, as forces grow like d^1.5.
constexpr std::array<double, 5> kAt{0.046910077030668, 0.230765344947158, 0.5, 0.769234655052842,
                                    0.953089922969332};
constexpr std::array<double, 5> kQuadratureWeight{0.118463442528095, 0.239314335249683, 0.284444444444444,
                                                  0.239314335249683, 0.118463442528095};

double half_width_of(double log_variance) {
  return ForceBudget::kOf95 * (kOfVariance * log_variance + kOfShares);
}

}  // namespace

SharesTouch::SharesTouch(const SolidTissue& tissue, const Fingertip& tip,
                         std::shared_ptr<const LayeredTouch> layers, std::shared_ptr<const FeltForce> felt,
                         double softer)
    : tip_(tip),
      grid_(tissue.grid),
      poisson_ratio_(tissue.poisson_ratio),
      layers_(std::move(layers)),
      felt_(std::move(felt)),
      softer_(softer) {
  if (layers_->max_m() < kShallowest) return;
  max_m_ = std::min({layers_->max_m(), kDeepest, std::nextafter(grid_.y_m.back(), 0)});
  for (std::size_t node = 0; node < grid_.columns(); ++node)
    near_pa_.push_back(static_cast<float>(modulus_near_pa(tissue, 0, node)));
}

FeltForce::At SharesTouch::felt(const Vector3& pose) const {
  return felt_->at(pose[0], pose[2], layers_->at(pose[1]).radius_m);
}

double SharesTouch::half_width(const Vector3& pose) const {
  return half_width_of(felt(pose).log_variance);
}

double SharesTouch::max_half_width(double indentation_m) const {
  return half_width_of(felt_->max_log_variance(layers_->at(indentation_m).radius_m));
}

// What finite strain takes of what is allowed is not there for the shares; where that takes all, no model is
// good enough, and finite strain is no reason for the nodes.
double SharesTouch::over(const Vector3& pose, const Tolerance& tolerance, FiniteStrain finite) const {
  const FeltForce::At felt = this->felt(pose);
  const double force_n = layers_->at(pose[1]).force_n / softer_ * std::exp(felt.log_mean);
  const double strain = ForceBudget::kOf95 * finite_strain(tip_, pose[1]).relative;
  double allowed = tolerance.of_n(force_n) / force_n;
  if (finite == FiniteStrain::kCounts && strain < allowed)
    allowed = std::sqrt(allowed * allowed - strain * strain);
  return half_width_of(felt.log_variance) / allowed;
}

ContactAnswer SharesTouch::answer(const Vector3& pose) const {
  const auto [x, d, z] = pose;
  ContactAnswer out;
  if (!(d > 0)) return out;
  Eigen::Vector2d sideways(0, 0);  // dU by x and z
  Eigen::Matrix2d bend = Eigen::Matrix2d::Zero();
  for (std::size_t q = 0; q < kAt.size(); ++q) {
    const double t = kAt[q], at = d * t * t;
    const LayeredTouch::At layer = layers_->at(at).times(1 / softer_);
    const FeltForce::At felt = felt_->at(x, z, layer.radius_m);
    const double work = 2 * d * t * kQuadratureWeight[q] * layer.force_n * std::exp(felt.log_mean);
    out.energy_j += work;
    sideways += work * felt.slope;
    bend += work * (felt.slope * felt.slope.transpose() + felt.curvature);
  }
  const LayeredTouch::At layer = layers_->at(d).times(1 / softer_);
  const FeltForce::At felt = felt_->at(x, z, layer.radius_m);
  const double force = layer.force_n * std::exp(felt.log_mean);
  // The radius grows as the layered stiffness has it: dF = k dd, and dF / da of a rounder contact.
  const double step = 1e-4 * d;
  const double by_depth = (std::log(layers_->at(d - step).radius_m) - std::log(layer.radius_m)) / -step;
  const double stiffness =
      layer.stiffness_n_m * std::exp(felt.log_mean) + force * felt.by_log_radius * by_depth;
  const Eigen::Vector2d slope = force * felt.slope;
  out.state = ContactState::kContact;
  out.force_n = {-sideways[0], -force, -sideways[1]};
  out.tangent_n_m = {-bend(0, 0), -slope[0],   -bend(0, 1), -slope[0],  -stiffness,
                     -slope[1],   -bend(1, 0), -slope[1],   -bend(1, 1)};
  out.path = SolvePath::kShares;
  out.solve.converged = true;
  out.solve.reason = "closed form";
  const double area = std::numbers::pi * layer.radius_m * layer.radius_m;
  set_strain(contact_strain(poisson_ratio_, force / area, near_pa_[nearest_node(grid_, pose)]),
             d / grid_.y_m.back(), out);
  out.budget.add(
      {ErrorTerm::kModel, TermKind::kEstimate, half_width_of(felt.log_variance) / ForceBudget::kOf95});
  out.budget.add(finite_strain(tip_, d));
  return out;
}

}  // namespace teletact::service
