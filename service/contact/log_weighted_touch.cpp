#include "service/contact/log_weighted_touch.h"

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <utility>

namespace teletact::service {
namespace {

// Gauss and Legendre's over [0, 1]; depths are d t^2, as forces grow like d^1.5.
constexpr std::array<double, 5> kAt{0.046910077030668, 0.230765344947158, 0.5, 0.769234655052842,
                                    0.953089922969332};
constexpr std::array<double, 5> kQuadratureWeight{0.118463442528095, 0.239314335249683, 0.284444444444444,
                                                  0.239314335249683, 0.118463442528095};

}  // namespace

LogWeightedTouch::LogWeightedTouch(std::shared_ptr<const LayeredTouch> layered,
                                   std::shared_ptr<const FeltForce> felt, double softer)
    : layered_(std::move(layered)), felt_(std::move(felt)), softer_(softer) {}

ContactAnswer LogWeightedTouch::answer(const Vector3& pose) const {
  const auto [x, d, z] = pose;
  ContactAnswer out;
  if (!(d > 0)) return out;
  Eigen::Vector2d sideways(0, 0);  // dU by x and z
  Eigen::Matrix2d bend = Eigen::Matrix2d::Zero();
  for (std::size_t q = 0; q < kAt.size(); ++q) {
    const double t = kAt[q], at = d * t * t;
    const LayeredTouch::At layer = layered_->at(at).times(1 / softer_);
    const FeltForce::At felt = felt_->at(x, z, layer.radius_m);
    const double work = 2 * d * t * kQuadratureWeight[q] * layer.force_n * std::exp(felt.log_mean);
    out.energy_j += work;
    sideways += work * felt.slope;
    bend += work * (felt.slope * felt.slope.transpose() + felt.curvature);
  }
  const LayeredTouch::At layer = layered_->at(d).times(1 / softer_);
  const FeltForce::At felt = felt_->at(x, z, layer.radius_m);
  const double force = layer.force_n * std::exp(felt.log_mean);
  // The radius grows as the layered stiffness has it: dF = k dd, and dF / da of a rounder contact.
  const double step = 1e-4 * d;
  const double by_depth = (std::log(layered_->at(d - step).radius_m) - std::log(layer.radius_m)) / -step;
  const double stiffness =
      layer.stiffness_n_m * std::exp(felt.log_mean) + force * felt.by_log_radius * by_depth;
  const Eigen::Vector2d slope = force * felt.slope;
  out.state = ContactState::kContact;
  out.force_n = {-sideways[0], -force, -sideways[1]};
  out.tangent_n_m = {-bend(0, 0), -slope[0],   -bend(0, 1), -slope[0],  -stiffness,
                     -slope[1],   -bend(1, 0), -slope[1],   -bend(1, 1)};
  return out;
}

FeltForce::At LogWeightedTouch::felt(const Vector3& pose) const {
  if (!(pose[1] > 0)) return {};
  return felt_->at(pose[0], pose[2], layered_->at(pose[1]).radius_m);
}

}  // namespace teletact::service
