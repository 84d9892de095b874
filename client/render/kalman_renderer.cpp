#include "client/render/kalman_renderer.h"

#include <algorithm>
#include <cmath>

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
  const double stiffness =
      std::max(options_.stiffness_walk_share * state_(0, 1), options_.stiffness_walk_n_m);
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

void KalmanRenderer::update(const ForceSample& sample, const ToolPose& pose, double time_s) noexcept {
  surface_m_ = sample.surface_m;
  const double indentation_m = sample.position_m.y() - sample.surface_m;
  if (!sample.contact || indentation_m < kSmallestIndentationM) return;
  const double tool_indentation_m = pose.position_m.y() - surface_m_;
  const Vector2 before =
      known_ ? Vector2(stiffness_at(pose.position_m.x(), tool_indentation_m) + blend_at(time_s))
             : Vector2::Zero();

  predict(sample.position_m.x(), indentation_m, sample.pose_time_s);
  const double force_noise = options_.force_noise_share * sample.force_n.norm() + options_.force_noise_n;
  const Eigen::Vector3d force_row(indentation_m, 0, 0);
  const bool believed = measure(force_row, -sample.force_n, force_noise * force_noise, true);
  if (!believed) {
    ++outliers_;
    gain_ = 0;
    if (++consecutive_outliers_ < options_.outliers_in_a_row) return start_blend(before, pose, time_s);
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
  start_blend(before, pose, time_s);
}

Vector2 KalmanRenderer::stiffness_at(double x_m, double indentation_m) const noexcept {
  const double dx_m = trusted_offset(x_m - anchor_x_m_, options_.correlation_m);
  const double dd_m = std::clamp(indentation_m - anchor_indentation_m_, -options_.reach_m, options_.reach_m);
  Vector2 k = state_.row(0) + dx_m * state_.row(1) + dd_m * state_.row(2);
  const double largest = options_.largest_growth * std::max(state_(0, 1), 0.0);
  k.y() = std::clamp(k.y(), 0.0, largest);
  k.x() = std::clamp(k.x(), -largest, largest);
  return k;
}

Vector2 KalmanRenderer::blend_at(double time_s) const noexcept {
  return offset_n_m_ * std::clamp(1 - (time_s - offset_time_s_) / blend_s_, 0.0, 1.0);
}

// The offset that keeps the force at the tool what it was, and a ramp slow enough for `largest_jump`.
void KalmanRenderer::start_blend(const Vector2& before_n_m, const ToolPose& pose, double time_s) noexcept {
  const double indentation_m = pose.position_m.y() - surface_m_;
  offset_n_m_.setZero();
  offset_time_s_ = time_s;
  blend_s_ = options_.shortest_blend_s;
  if (indentation_m <= 0) return;
  const Vector2 after_n_m = stiffness_at(pose.position_m.x(), indentation_m);
  offset_n_m_ = before_n_m - after_n_m;
  // Every tick passes T / blend of the offset: no more than a share of the smaller force, or what nobody
  // feels.
  const double smaller_n = indentation_m * std::min(before_n_m.norm(), after_n_m.norm());
  const double allowed_n = std::max(options_.largest_jump * smaller_n, options_.unfelt_jump_n);
  const double slowest_s = options_.servo_period_s * indentation_m * offset_n_m_.norm() / allowed_n;
  blend_s_ = std::clamp(slowest_s, options_.shortest_blend_s, options_.longest_blend_s);
}

Rendered KalmanRenderer::render(const ToolPose& pose, double time_s) noexcept {
  Rendered rendered;
  rendered.variance = covariance_(0, 0);
  rendered.gain = gain_;
  const double indentation_m = pose.position_m.y() - surface_m_;
  if (!known_ || indentation_m <= 0) return rendered;
  Vector2 k = stiffness_at(pose.position_m.x(), indentation_m) + blend_at(time_s);
  k.y() = std::max(k.y(), 0.0);
  rendered.stiffness_n_m = k.y();
  rendered.force_n = -indentation_m * k;
  return rendered;
}

}  // namespace teletact::client
