#include "client/render/kalman_renderer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

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
Vector2 trusted_offset(const Vector2& offset_m, double correlation_m) noexcept {
  const double share_squared = (offset_m / correlation_m).squaredNorm();
  const double third = std::pow(std::max(1 - share_squared / 12, 0.0), 2);
  return offset_m * third * third * third;
}

}  // namespace

void KalmanRenderer::reset() noexcept {
  *this = KalmanRenderer(options_);
}

KalmanRenderer::Place KalmanRenderer::place_of(const Vector3& position_m) const noexcept {
  return {lateral(frame_.to_contact(position_m - anchor_m_)), surface_.depth_m(position_m)};
}

// From the anchor to there.
double KalmanRenderer::way_m(const Place& place) const noexcept {
  return std::hypot(place.along_m.norm(), place.indentation_m - anchor_indentation_m_);
}

void KalmanRenderer::put_anchor(const Vector3& position_m, double time_s) noexcept {
  anchor_m_ = position_m;
  anchor_indentation_m_ = surface_.depth_m(position_m);
  anchor_time_s_ = time_s;
}

void KalmanRenderer::forget(const Vector3& position_m, double time_s) noexcept {
  const double gradient = options_.use_tangent ? kUnknownGradientNM2 : 0;
  covariance_ = Row(kUnknownStiffnessNM, gradient, gradient, gradient).cwiseAbs2().asDiagonal();
  state_.bottomRows<3>().setZero();
  put_anchor(position_m, time_s);
}

double KalmanRenderer::walk_n_m() const noexcept {
  return std::max(options_.stiffness_walk_share * state_(0, 1), options_.stiffness_walk_n_m);
}

// Moves the anchor: k follows the gradient, everything walks with Q dt.
void KalmanRenderer::predict(const Vector3& position_m, double time_s) noexcept {
  const Place place = place_of(position_m);
  if (!known_ || way_m(place) > 2 * options_.reach_m) {
    forget(position_m, time_s);
    return;
  }
  const double dt_s = std::max(time_s - anchor_time_s_, 0.0);
  // x(n) = F x(n-1), P = F P F^T + Q dt
  Eigen::Matrix4d step = Eigen::Matrix4d::Identity();
  step.block<1, 2>(0, 1) = place.along_m.transpose();
  step(0, 3) = place.indentation_m - anchor_indentation_m_;
  state_ = (step * state_).eval();
  covariance_ = (step * covariance_ * step.transpose()).eval();
  const double stiffness = walk_n_m();
  const double gradient = options_.use_tangent ? options_.gradient_walk_1_m * stiffness : 0;
  covariance_.diagonal() += dt_s * Row(stiffness, gradient, gradient, gradient).cwiseAbs2();
  put_anchor(position_m, std::max(time_s, anchor_time_s_));
}

// One scalar measurement row for all channels. False: outside the gate, nothing changed.
bool KalmanRenderer::measure(const Row& row, const Vector3& value, double variance, bool gated) noexcept {
  // S = H P H^T + R, K = P H^T / S, nu = z - H x
  const Row covariance_row = covariance_ * row;
  const double innovation_variance = row.dot(covariance_row) + variance;
  const Vector3 innovation = value - state_.transpose() * row;
  const double gate = options_.gate_sigma * options_.gate_sigma * innovation_variance;
  if (gated && innovation.squaredNorm() > gate) return false;
  const Row gain = covariance_row / innovation_variance;
  state_ += gain * innovation.transpose();
  // Joseph's form keeps P symmetric and positive: P = (I - K H) P (I - K H)^T + K R K^T
  const Eigen::Matrix4d keep = Eigen::Matrix4d::Identity() - gain * row.transpose();
  covariance_ = (keep * covariance_ * keep.transpose() + gain * variance * gain.transpose()).eval();
  if (gated) gain_ = gain.dot(row);
  return true;
}

// The answer into state and covariance. False: an outlier, nothing changed.
bool KalmanRenderer::believe(const ForceSample& sample) noexcept {
  predict(sample.position_m, sample.pose_time_s);
  const double indentation_m = surface_.depth_m(sample.position_m);
  const double force_noise = options_.force_noise_share * sample.force_n.norm() + options_.force_noise_n;
  const Row force_row(indentation_m, 0, 0, 0);
  const Vector3 resistance_n = frame_.to_contact(-sample.force_n);
  // Of next to no indentation the force says nothing of the stiffness; its tangent does.
  const bool tells = indentation_m >= kSmallestIndentationM;
  if (tells && !measure(force_row, resistance_n, force_noise * force_noise, true)) {
    ++outliers_;
    gain_ = 0;
    if (++consecutive_outliers_ < options_.outliers_in_a_row) return false;
    forget(sample.position_m, sample.pose_time_s);
    measure(force_row, resistance_n, force_noise * force_noise, true);
  }
  consecutive_outliers_ = 0;
  known_ = true;
  if (options_.use_tangent) {
    const Matrix3 tangent_n_m = frame_.tensor_to_contact(sample.tangent_n_m);
    const Vector3 along_push = -tangent_n_m.col(1);
    const double noise = options_.tangent_noise_share * tangent_n_m.norm() + options_.tangent_noise_n_m;
    measure(Row(1, 0, 0, indentation_m), along_push, noise * noise, false);
    measure(Row(0, indentation_m, 0, 0), -tangent_n_m.col(0), noise * noise, false);
    measure(Row(0, 0, indentation_m, 0), -tangent_n_m.col(2), noise * noise, false);
  }
  state_(0, 1) = std::max(state_(0, 1), 0.0);  // k >= 0: tissue never pulls
  return true;
}

bool KalmanRenderer::update(const ForceSample& sample, const ToolPose& pose, double) noexcept {
  const Vector3 before = felt_at(place_of(pose.position_m));
  surface_ = sample.surface;
  frame_ = ContactFrame(surface_.normal);
  const double indentation_m = surface_.depth_m(sample.position_m);
  bool believed = true;
  if (sample.contact || sample.foreseen) {
    const bool tells = options_.use_tangent || indentation_m >= kSmallestIndentationM;
    if (indentation_m > 0 && tells) believed = believe(sample);
  } else if (indentation_m > 0 || place_of(sample.position_m).along_m.norm() > 2 * options_.reach_m) {
    known_ = false;  // nothing to feel where the finger presses, or nothing known of where it has gone
  }
  blend_from(before, pose.position_m);
  return believed;
}

// What of the state is the stiffness somewhere else, as far as its gradients are trusted.
KalmanRenderer::Row KalmanRenderer::row_at(const Place& place) const noexcept {
  const Vector2 along_m = trusted_offset(place.along_m, options_.correlation_m);
  const double dd_m = place.indentation_m - anchor_indentation_m_;
  return {1, along_m.x(), along_m.y(), std::clamp(dd_m, -options_.reach_m, options_.reach_m)};
}

// What pushes a finger along the surface is the gradient of the stiffness (T4.5): of the anchor's, what is
// still trusted there, the gradient of the trusted offset along it. All of it would drive a finger on as far
// as it slides.
double KalmanRenderer::kept_sideways(const Place& place) const noexcept {
  if (!options_.use_tangent) return 1;
  const Vector2 shares = place.along_m / options_.correlation_m;
  const double left = std::max(1 - shares.squaredNorm() / 12, 0.0);
  const double along = shares.dot(lateral(state_.row(0)).normalized());
  return left * left * left * left * left * (left - along * along);
}

double KalmanRenderer::push_at(const Row& row) const noexcept {
  return std::clamp(state_.col(1).dot(row), 0.0, largest_n_m());
}

Vector3 KalmanRenderer::stiffness_at(const Place& place) const noexcept {
  const Row row = row_at(place);
  const double lost = 1 - kept_sideways(place), max = largest_n_m();
  Vector3 k = state_.transpose() * row;
  k -= lost * Vector3(state_(0, 0), 0, state_(0, 2));
  return {std::clamp(k.x(), -max, max), push_at(row), std::clamp(k.z(), -max, max)};
}

// Of that stiffness: h P h^T + Q t, of any component.
double KalmanRenderer::variance_at(const Place& place, double time_s) const noexcept {
  if (!known_) return std::numeric_limits<double>::infinity();
  const Row row = row_at(place);
  const double walked = walked_s(time_s - anchor_time_s_, way_m(place), options_.correlation_m);
  return row.dot(covariance_ * row) + walk_n_m() * walk_n_m() * walked;
}

Vector3 KalmanRenderer::felt_at(const Place& place) const noexcept {
  if (place.indentation_m <= 0) return Vector3::Zero();
  return blend_.felt(known_ ? stiffness_at(place) : Vector3(Vector3::Zero()));
}

// Of the field that is felt, straight up to the surface: Int k d dd, by Gauss' rule of three points (exact
// where k is linear in d; it bends where its gradient is no longer trusted).
double KalmanRenderer::stored_at(const Place& place) const noexcept {
  constexpr double kOutermost = 0.7745966692414834;  // sqrt(3/5)
  const double half_m = std::max(place.indentation_m, 0.0) / 2;
  const auto resistance_n = [&](double share) {
    const double indentation_m = (1 + share) * half_m;
    const double push_n_m = known_ ? push_at(row_at({place.along_m, indentation_m})) : 0;
    return indentation_m * blend_.felt({0, push_n_m, 0}).y();
  };
  return half_m / 9 * (5 * resistance_n(-kOutermost) + 8 * resistance_n(0) + 5 * resistance_n(kOutermost));
}

// What is felt at the tool stays what it was.
void KalmanRenderer::blend_from(const Vector3& before_n_m, const Vector3& position_m) noexcept {
  const Place place = place_of(position_m);
  if (place.indentation_m <= 0) return blend_.change(Vector3::Zero(), Vector3::Zero());
  blend_.change(before_n_m, known_ ? stiffness_at(place) : Vector3(Vector3::Zero()));
}

Rendered KalmanRenderer::render(const ToolPose& pose, double time_s, EnergyLedger& ledger,
                                double share) noexcept {
  Rendered rendered;
  rendered.gain = gain_;
  const Place place = place_of(pose.position_m);
  const double indentation_m = place.indentation_m;
  rendered.variance = variance_at(place, time_s);
  rendered.lateral_variance.setConstant(rendered.variance);
  const double elapsed_s = time_s - std::exchange(rendered_s_, time_s);
  if (indentation_m <= 0) {
    blend_.clear();
    return rendered;
  }
  const Vector3 model_n_m = known_ ? stiffness_at(place) : Vector3(Vector3::Zero());
  blend_.settle(model_n_m, indentation_m, elapsed_s, ledger, share);
  const Vector3 k = blend_.felt(model_n_m);
  rendered.stiffness_n_m = k.y();
  rendered.lateral_stiffness_n_m = lateral(k);
  const Vector3 missing = (k - model_n_m).cwiseAbs2();
  rendered.variance += missing.y();
  // An estimate of which a share is kept, as of a walk that has come to its sill; or all that is not kept.
  const double kept = kept_sideways(place);
  const Vector2 lost_n_m = (1 - kept) * lateral(state_.row(0));
  rendered.lateral_variance =
      ((1 + kept * kept) / 2 * rendered.lateral_variance).cwiseMax(lost_n_m.cwiseAbs2()) + lateral(missing);
  rendered.force_n = frame_.to_scene(-indentation_m * k);
  rendered.stored_j = stored_at(place);
  rendered.withheld = blend_.withheld();
  return rendered;
}

}  // namespace teletact::client
