#include "client/render/kalman_renderer.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace teletact::client {
namespace {

// A force over less indentation than this says nothing of the stiffness.
constexpr double kSmallestIndentationM = 1e-4;
// Standard deviations before the first answer: wide beside any tissue.
constexpr double kUnknownStiffnessNM = 1e5;
constexpr double kUnknownGradientNM2 = 1e7;

// The best guess of a stiffness at a distance d from where it and its gradient g are known, when nothing else
// is known of it but that it is correlated as exp(-d^2 / 2 l^2): k + g d exp(-d^2 / 2 l^2). Here d exp(...),
// its tail bent to end at 3.5 l: (1 - d^2 / 12 l^2)^6.
double trusted_offset(double offset_m, double correlation_m) noexcept {
  const double share = offset_m / correlation_m;
  const double third = std::pow(std::max(1 - share * share / 12, 0.0), 2);
  return offset_m * third * third * third;
}

}  // namespace

void KalmanRenderer::reset() noexcept {
  *this = KalmanRenderer(options_);
}

void KalmanRenderer::forget(double x_m, double indentation_m, double time_s) noexcept {
  const double gradient = options_.use_tangent ? kUnknownGradientNM2 : 0;
  covariance_ = Eigen::Vector3d(kUnknownStiffnessNM, gradient, gradient).cwiseAbs2().asDiagonal();
  state_.bottomRows<2>().setZero();
  anchor_x_m_ = x_m;
  anchor_indentation_m_ = indentation_m;
  anchor_time_s_ = time_s;
}

double KalmanRenderer::walk_n_m() const noexcept {
  return std::max(options_.stiffness_walk_share * state_(0, 1), options_.stiffness_walk_n_m);
}

// Moves the anchor: k follows the gradient, everything walks with Q dt.
void KalmanRenderer::predict(double x_m, double indentation_m, double time_s) noexcept {
  const double dx_m = x_m - anchor_x_m_;
  const double dd_m = indentation_m - anchor_indentation_m_;
  if (!known_ || std::hypot(dx_m, dd_m) > 2 * options_.reach_m) {
    forget(x_m, indentation_m, time_s);
    return;
  }
  const double dt_s = std::max(time_s - anchor_time_s_, 0.0);
  // x(n) = F x(n-1), P = F P F^T + Q dt
  Eigen::Matrix3d step = Eigen::Matrix3d::Identity();
  step(0, 1) = dx_m;
  step(0, 2) = dd_m;
  state_ = (step * state_).eval();
  covariance_ = (step * covariance_ * step.transpose()).eval();
  const double stiffness = walk_n_m();
  const double gradient = options_.use_tangent ? options_.gradient_walk_1_m * stiffness : 0;
  covariance_.diagonal() += dt_s * Eigen::Vector3d(stiffness, gradient, gradient).cwiseAbs2();
  anchor_x_m_ = x_m;
  anchor_indentation_m_ = indentation_m;
  anchor_time_s_ = std::max(time_s, anchor_time_s_);
}

// One scalar measurement row for both channels. False: outside the gate, nothing changed.
bool KalmanRenderer::measure(const Eigen::Vector3d& row, const Vector2& value, double variance,
                             bool gated) noexcept {
  // S = H P H^T + R, K = P H^T / S, nu = z - H x
  const Eigen::Vector3d covariance_row = covariance_ * row;
  const double innovation_variance = row.dot(covariance_row) + variance;
  const Vector2 innovation = value - state_.transpose() * row;
  const double gate = options_.gate_sigma * options_.gate_sigma * innovation_variance;
  if (gated && innovation.squaredNorm() > gate) return false;
  const Eigen::Vector3d gain = covariance_row / innovation_variance;
  state_ += gain * innovation.transpose();
  // Joseph's form keeps P symmetric and positive: P = (I - K H) P (I - K H)^T + K R K^T
  const Eigen::Matrix3d keep = Eigen::Matrix3d::Identity() - gain * row.transpose();
  covariance_ = (keep * covariance_ * keep.transpose() + gain * variance * gain.transpose()).eval();
  if (gated) gain_ = gain.dot(row);
  return true;
}

// The answer into state and covariance. False: an outlier, nothing changed.
bool KalmanRenderer::believe(const ForceSample& sample, double indentation_m) noexcept {
  predict(sample.position_m.x(), indentation_m, sample.pose_time_s);
  const double force_noise = options_.force_noise_share * sample.force_n.norm() + options_.force_noise_n;
  const Eigen::Vector3d force_row(indentation_m, 0, 0);
  // Of next to no indentation the force says nothing of the stiffness; its tangent does.
  const bool tells = indentation_m >= kSmallestIndentationM;
  if (tells && !measure(force_row, -sample.force_n, force_noise * force_noise, true)) {
    ++outliers_;
    gain_ = 0;
    if (++consecutive_outliers_ < options_.outliers_in_a_row) return false;
    forget(sample.position_m.x(), indentation_m, sample.pose_time_s);
    measure(force_row, -sample.force_n, force_noise * force_noise, true);
  }
  consecutive_outliers_ = 0;
  known_ = true;
  if (options_.use_tangent) {
    const Vector2 along_push = -sample.tangent_n_m.col(1);
    const Vector2 along_surface = -sample.tangent_n_m.col(0);
    const double noise =
        options_.tangent_noise_share * sample.tangent_n_m.norm() + options_.tangent_noise_n_m;
    measure(Eigen::Vector3d(1, 0, indentation_m), along_push, noise * noise, false);
    measure(Eigen::Vector3d(0, indentation_m, 0), along_surface, noise * noise, false);
  }
  state_(0, 1) = std::max(state_(0, 1), 0.0);  // k >= 0: tissue never pulls
  return true;
}

bool KalmanRenderer::update(const ForceSample& sample, const ToolPose& pose, double) noexcept {
  const Vector2 before = felt_at(pose.position_m);
  surface_m_ = sample.surface_m;
  const double indentation_m = sample.position_m.y() - sample.surface_m;
  bool believed = true;
  if (sample.contact || sample.foreseen) {
    const bool tells = options_.use_tangent || indentation_m >= kSmallestIndentationM;
    if (indentation_m > 0 && tells) believed = believe(sample, indentation_m);
  } else if (indentation_m > 0 || std::abs(sample.position_m.x() - anchor_x_m_) > 2 * options_.reach_m) {
    known_ = false;  // nothing to feel where the finger presses, or nothing known of where it has gone
  }
  blend_from(before, pose);
  return believed;
}

// What of the state is the stiffness somewhere else, as far as its gradients are trusted.
Eigen::Vector3d KalmanRenderer::row_at(double x_m, double indentation_m) const noexcept {
  const double dd_m = indentation_m - anchor_indentation_m_;
  return {1, trusted_offset(x_m - anchor_x_m_, options_.correlation_m),
          std::clamp(dd_m, -options_.reach_m, options_.reach_m)};
}

Vector2 KalmanRenderer::stiffness_at(double x_m, double indentation_m) const noexcept {
  Vector2 k = state_.transpose() * row_at(x_m, indentation_m);
  const double largest = options_.largest_growth * std::max(state_(0, 1), 0.0);
  k.y() = std::clamp(k.y(), 0.0, largest);
  k.x() = std::clamp(k.x(), -largest, largest);
  return k;
}

// Of that stiffness: h P h^T + Q t, of either component.
double KalmanRenderer::variance_at(double x_m, double indentation_m, double time_s) const noexcept {
  if (!known_) return std::numeric_limits<double>::infinity();
  const Eigen::Vector3d row = row_at(x_m, indentation_m);
  const double way_m = std::hypot(x_m - anchor_x_m_, indentation_m - anchor_indentation_m_);
  const double walked = walked_s(time_s - anchor_time_s_, way_m, options_.correlation_m);
  return row.dot(covariance_ * row) + walk_n_m() * walk_n_m() * walked;
}

Vector2 KalmanRenderer::felt_at(const Vector2& position_m) const noexcept {
  const double indentation_m = position_m.y() - surface_m_;
  if (indentation_m <= 0) return Vector2::Zero();
  Vector2 k = offset_n_m_;
  if (known_) k += (1 - withheld_) * stiffness_at(position_m.x(), indentation_m);
  k.y() = std::max(k.y(), 0.0);
  return k;
}

// Of the field that is felt, straight up to the surface: Int k d dd, by Gauss' rule of three points (exact
// where k is linear in d; it bends where its gradient is no longer trusted).
double KalmanRenderer::stored_at(const Vector2& position_m) const noexcept {
  constexpr double kOutermost = 0.7745966692414834;  // sqrt(3/5)
  const double half_m = std::max(position_m.y() - surface_m_, 0.0) / 2;
  const auto resistance_n = [&](double share) {
    const double indentation_m = (1 + share) * half_m;
    return indentation_m * felt_at({position_m.x(), surface_m_ + indentation_m}).y();
  };
  return half_m / 9 * (5 * resistance_n(-kOutermost) + 8 * resistance_n(0) + 5 * resistance_n(kOutermost));
}

// What is felt at the tool stays what it was: of a harder model the surplus is withheld, the rest is an
// offset.
void KalmanRenderer::blend_from(const Vector2& before_n_m, const ToolPose& pose) noexcept {
  withheld_ = 0;
  offset_n_m_.setZero();
  const double indentation_m = pose.position_m.y() - surface_m_;
  if (indentation_m <= 0) return;
  Vector2 after_n_m = Vector2::Zero();
  if (known_) after_n_m = stiffness_at(pose.position_m.x(), indentation_m);
  if (after_n_m.y() > before_n_m.y()) withheld_ = 1 - before_n_m.y() / after_n_m.y();
  offset_n_m_ = before_n_m - (1 - withheld_) * after_n_m;
}

// Some servo periods further towards the model: no faster than `largest_jump`, and no more of what is
// withheld than is paid for.
void KalmanRenderer::settle(const Vector2& model_n_m, double indentation_m, double ticks) noexcept {
  const double half_square = indentation_m * indentation_m / 2;  // 1/2 d^2: energy per stiffness
  const double felt_n_m = (offset_n_m_ + (1 - withheld_) * model_n_m).norm();
  double step_n_m = std::max(std::expm1(ticks * std::log1p(options_.largest_jump)) * felt_n_m,
                             ticks * options_.unfelt_jump_n / indentation_m);
  const double missing_n_m = withheld_ * std::max(model_n_m.y(), 0.0);
  if (missing_n_m > 0) {
    const double given_n_m = std::min({missing_n_m, step_n_m, reserve_j_ / half_square});
    withheld_ -= withheld_ * given_n_m / missing_n_m;
    reserve_j_ -= half_square * given_n_m;
    step_n_m -= given_n_m;
  }
  const double offset_n_m = offset_n_m_.norm();
  if (offset_n_m > 0) {
    const Vector2 less_n_m = std::min(1.0, step_n_m / offset_n_m) * offset_n_m_;
    offset_n_m_ -= less_n_m;
    reserve_j_ += half_square * std::max(less_n_m.y(), 0.0);
  }
}

Rendered KalmanRenderer::render(const ToolPose& pose, double time_s, double dissipated_j) noexcept {
  Rendered rendered;
  rendered.gain = gain_;
  const double x_m = pose.position_m.x();
  const double indentation_m = pose.position_m.y() - surface_m_;
  rendered.variance = rendered.lateral_variance = variance_at(x_m, indentation_m, time_s);
  constexpr double kMostTicks = 1000;  // all is blended in by then
  const double ticks = std::clamp((time_s - rendered_s_) / options_.servo_period_s, 0.0, kMostTicks);
  rendered_s_ = time_s;
  if (indentation_m <= 0) {
    withheld_ = reserve_j_ = 0;
    offset_n_m_.setZero();
    return rendered;
  }
  reserve_j_ = std::isfinite(dissipated_j) ? std::min(reserve_j_ + dissipated_j, options_.largest_reserve_j)
                                           : dissipated_j;
  const Vector2 model_n_m = known_ ? stiffness_at(x_m, indentation_m) : Vector2(Vector2::Zero());
  settle(model_n_m, indentation_m, ticks);
  const Vector2 k = felt_at(pose.position_m);
  rendered.stiffness_n_m = k.y();
  rendered.lateral_stiffness_n_m = k.x();
  const Vector2 missing = (k - model_n_m).cwiseAbs2();
  rendered.variance += missing.y();
  rendered.lateral_variance += missing.x();
  rendered.force_n = -indentation_m * k;
  rendered.stored_j = stored_at(pose.position_m);
  rendered.withheld = withheld_;
  return rendered;
}

}  // namespace teletact::client
