#include "service/contact/closed_touch.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "service/contact/solid_answer.h"

namespace teletact::service {
namespace {

// What log-weighted shares are off by, over the variance of ln(E / E0) in what is felt, and beside that:
// within twice this in 95 of 100 (bench plan).
constexpr double kOfVariance = 0.25, kOfShares = 0.0015;
// U over F d, of forces that grow as d^1.5.
constexpr double kWork = 0.4;
// Indentations that places are compared at, and how deep closed forms answer.
constexpr std::array kDepths{0.0003, 0.001, 0.002, 0.004, 0.008};
constexpr double kDeepest = 0.010;

double of_shares(double variance) {
  return ForceBudget::kOf95 * (kOfVariance * variance + kOfShares);
}

// Of contacts as wide as the radii of the table on both sides of this one.
FeltForce::Extent around(const std::vector<FeltForce::Extent>& extents, double radius_m) {
  const auto above = std::ranges::lower_bound(extents, radius_m, {}, &FeltForce::Extent::radius_m);
  FeltForce::Extent out = above == extents.end() ? extents.back() : *above;
  if (above == extents.begin()) return out;
  const FeltForce::Extent& below = *(above - 1);
  return {radius_m, std::min(out.least, below.least), std::max(out.most, below.most),
          std::max(out.steepest_1_m, below.steepest_1_m), std::max(out.most_variance, below.most_variance)};
}

}  // namespace

ClosedTouch::ClosedTouch(const SolidTissue& tissue, const Fingertip& tip,
                         std::shared_ptr<const LayeredTouch> unit_layer,
                         std::shared_ptr<const LayeredTouch> layers,
                         const std::shared_ptr<const FeltForce>& felt, double softer)
    : tip_(tip),
      grid_(tissue.grid),
      poisson_ratio_(tissue.poisson_ratio),
      unit_layer_(std::move(unit_layer)),
      layers_(std::move(layers)),
      softer_(softer),
      shares_(layers_, felt, softer) {
  const double known_m = std::min(unit_layer_->most_m(), layers_->most_m());
  const auto extents = felt->extents();
  double least = HUGE_VAL, most = -HUGE_VAL;  // ln of the modulus that a homogeneous layer would take
  for (const double d : kDepths) {
    if (d > known_m || d >= grid_.y_m.back()) break;
    const LayeredTouch::At at = layers_->at(d).times(1 / softer);
    const double unit_n = unit_layer_->at(d).force_n;
    const FeltForce::Extent felt_here = around(extents, at.radius_m);
    depths_.push_back({d, unit_n, at.force_n, felt_here});
    least = std::min(least, std::log(at.force_n / unit_n) + felt_here.least);
    most = std::max(most, std::log(at.force_n / unit_n) + felt_here.most);
  }
  if (depths_.empty()) return;
  modulus_pa_ = std::exp((least + most) / 2);
  for (Depth& at : depths_) at.layer_n *= modulus_pa_;
  most_m_ = std::min({known_m, kDeepest, std::nextafter(grid_.y_m.back(), 0)});
  for (std::size_t node = 0; node < grid_.columns(); ++node)
    near_pa_.push_back(static_cast<float>(modulus_near_pa(tissue, 0, node)));
}

double ClosedTouch::half_width(SolvePath model, const Depth& at, double m) const {
  double lacks = 0;
  if (model != SolvePath::kShares) {
    const double model_n = model == SolvePath::kLayers ? at.layers_n : at.layer_n;
    lacks = std::hypot(model_n / (at.layers_n * std::exp(m)) - 1,
                       kWork * at.indentation_m * at.felt.steepest_1_m);
  }
  return lacks + of_shares(at.felt.most_variance);
}

double ClosedTouch::most_half_width(SolvePath model, const Depth& at) const {
  return std::max(half_width(model, at, at.felt.least), half_width(model, at, at.felt.most));
}

// Of the depths on both sides the one that is more off.
double ClosedTouch::most_half_width(SolvePath model, double indentation_m) const {
  const auto below = std::ranges::lower_bound(depths_, indentation_m, {}, &Depth::indentation_m);
  const auto last = depths_.end() - 1, first = depths_.begin();
  return std::max(most_half_width(model, *std::min(below, last)),
                  most_half_width(model, *(below == first ? first : below - 1)));
}

double ClosedTouch::half_width(SolvePath model, const Vector3& pose) const {
  return model == SolvePath::kShares ? of_shares(shares_.felt(pose).log_variance)
                                     : most_half_width(model, pose[1]);
}

// What is allowed of such a force, over it, less what finite strain takes of it; where that takes all, no
// model is good enough, and finite strain is no reason for a dearer one.
double ClosedTouch::left(double force_n, double indentation_m, const Tolerance& tolerance,
                         FiniteStrain finite) const {
  const double allowed = tolerance.of_n(force_n) / force_n,
               strain = ForceBudget::kOf95 * finite_strain(tip_, indentation_m).relative;
  if (finite == FiniteStrain::kLeftOut || strain >= allowed) return allowed;
  return std::sqrt(allowed * allowed - strain * strain);
}

double ClosedTouch::over(SolvePath model, const Vector3& pose, const Tolerance& tolerance,
                         FiniteStrain finite) const {
  const double d = pose[1],
               force_n = layers_->at(d).force_n / softer_ * std::exp(shares_.felt(pose).log_mean);
  return half_width(model, pose) / left(force_n, d, tolerance, finite);
}

double ClosedTouch::most_over(SolvePath model, const Tolerance& tolerance, FiniteStrain finite) const {
  double most = 0;
  for (const Depth& at : depths_)
    for (const double m : {at.felt.least, at.felt.most})
      most = std::max(most, half_width(model, at, m) /
                                left(at.layers_n * std::exp(m), at.indentation_m, tolerance, finite));
  return most;
}

ContactAnswer ClosedTouch::answer(SolvePath model, const Vector3& pose) const {
  const double d = pose[1];
  ContactAnswer out;
  if (!(d > 0)) return out;
  const LayeredTouch::At layers = layers_->at(d).times(1 / softer_);
  if (model == SolvePath::kShares) {
    out = shares_.answer(pose);
  } else {
    const LayeredTouch::At at = model == SolvePath::kLayers ? layers : unit_layer_->at(d).times(modulus_pa_);
    out.state = ContactState::kContact;
    out.force_n = {0, -at.force_n, 0};
    out.tangent_n_m[4] = -at.stiffness_n_m;
    out.energy_j = at.energy_j;
  }
  out.path = model;
  out.solve.converged = true;
  out.solve.reason = "closed form";
  const double area = std::numbers::pi * layers.radius_m * layers.radius_m;
  set_strain(contact_strain(poisson_ratio_, -out.force_n[1] / area, near_pa_[nearest_node(grid_, pose)]),
             d / grid_.y_m.back(), out);
  out.budget.add({ErrorTerm::kModel, TermKind::kEstimate, half_width(model, pose) / ForceBudget::kOf95});
  out.budget.add(finite_strain(tip_, d));
  return out;
}

}  // namespace teletact::service
