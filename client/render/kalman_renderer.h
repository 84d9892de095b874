// Kalman-filtered local contact model (T5.4), extended to space and to a finger that moves sideways.
//
// All of it is kept in the contact's own frame (contact_frame.h), which turns with the surface: the
// indentation d along its normal, and u, v along it. Resistance r = -force on the finger. The local model is
//     r_i(u, v, d) = d * ( k_i + g_iu (u - u_a) + g_iv (v - v_a) + g_id (d - d_a) ),
//     i = lateral, push, second lateral,
// a secant stiffness k_i (N/m) at the anchor pose (u_a, v_a, d_a) and its gradient (N/m per m). It is the
// first-order expansion of the streamed force, F_0 + T (p - p_0), written so that it vanishes with the
// indentation: no force is left outside the tissue, and the lateral parts, which keep the work of a
// press-slide-release loop zero (T4.5), vanish with it. In a plane scene all that has to do with v is told as
// zero, and stays zero.
//
// State per channel [k, g_u, g_v, g_d], one covariance for all (same measurement rows, same noise).
// Measurements of an answer, all at the pose that it was computed for:
//     r_i                        = d_0 k_i              (force)
//     d r_i / d d                = k_i + d_0 g_id       (tangent)
//     d r_i / d u, d r_i / d v   = d_0 g_iu, d_0 g_iv   (tangent)
// Between poses k moves by the gradient (the anchor moves with the finger), and all states walk with Q dt.
// With `use_tangent` off the gradients are held at zero and this is the paper's one-state filter [k].
//
// Model updates are continuous (T5.4) and paid for: paid_blend.h.
//
// The variance that is reported is the covariance carried on from the newest answer to the tool, h P h^T + Q
// t (t: tissue_walk.h), the same for all channels, and the square of what is not yet blended in. Sideways,
// where a share s of the answer's is kept, (1 + s^2)/2 of the first, but at least the square of what is lost.
#pragma once

#include <Eigen/Core>

#include "client/render/paid_blend.h"
#include "client/render/renderer.h"
#include "client/render/tissue_walk.h"

namespace teletact::client {

struct KalmanOptions {
  bool use_tangent = true;
  // Random walk, per square root of a second (tissue_walk.h). It is wide beside the noise: FE forces carry no
  // sensor noise.
  double stiffness_walk_share = kWalkShare;
  double stiffness_walk_n_m = kWalkNM;
  double gradient_walk_1_m = 300;  // of the gradient, per unit of the stiffness' walk
  // Measurement noise: linearisation and solver error, a share of the value and a floor.
  double force_noise_share = 0.005;
  double force_noise_n = 0.002;
  double tangent_noise_share = 0.01;
  double tangent_noise_n_m = 1;
  // An answer is an outlier when its force innovation exceeds this many standard deviations ...
  double gate_sigma = 6;
  int outliers_in_a_row = 3;  // ... unless this many come in a row: then the tissue has changed
  // Trust in the gradient: how far below and above the anchor the expansion goes, and what k may become by
  // it. Sideways it is followed as far as stiffness is correlated (an inclusion of 10 mm, the middle of T2.7)
  // and given up further on: a straight line overshoots at an inclusion's edge, which is then felt too hard.
  double reach_m = 0.004;
  double correlation_m = kCorrelationM;
  double largest_growth = 3;
  PaidBlendOptions blend = {};  // of model updates
};

class KalmanRenderer final : public Renderer {
 public:
  explicit KalmanRenderer(const KalmanOptions& options = {}) : options_(options), blend_(options.blend) {}
  void reset() noexcept override;
  bool update(const ForceSample& sample, const ToolPose& pose, double time_s) noexcept override;
  using Renderer::render;
  Rendered render(const ToolPose& pose, double time_s, EnergyLedger& ledger) noexcept override {
    return render(pose, time_s, ledger, 1);
  }
  // For who lets out no more than `share` of what this one's force holds.
  Rendered render(const ToolPose& pose, double time_s, EnergyLedger& ledger, double share) noexcept;

  // The model is felt as it is from now on, nothing blended in: by who does not render this one's force.
  void take_all() noexcept { blend_.clear(); }
  // What it knows is of other tissue than the next answer, which is believed as the first one is.
  void distrust() noexcept { known_ = false; }

  std::uint64_t outliers() const noexcept { return outliers_; }

 private:
  using Row = Eigen::Vector4d;                // k, g_u, g_v, g_d
  using State = Eigen::Matrix<double, 4, 3>;  // rows so; columns lateral, push, second lateral

  // A place as the contact has it.
  struct Place {
    Vector2 along_m;  // the surface, from the anchor
    double indentation_m;
  };
  Place place_of(const Vector3& position_m) const noexcept;

  void predict(const Vector3& position_m, double time_s) noexcept;
  bool measure(const Row& row, const Vector3& value, double variance, bool gated) noexcept;
  void forget(const Vector3& position_m, double time_s) noexcept;
  void put_anchor(const Vector3& position_m, double time_s) noexcept;
  bool believe(const ForceSample& sample) noexcept;
  double walk_n_m() const noexcept;
  double way_m(const Place&) const noexcept;
  Row row_at(const Place&) const noexcept;
  double largest_n_m() const noexcept { return options_.largest_growth * std::max(state_(0, 1), 0.0); }
  double push_at(const Row&) const noexcept;
  double kept_sideways(const Place&) const noexcept;
  Vector3 stiffness_at(const Place&) const noexcept;
  double variance_at(const Place&, double time_s) const noexcept;
  Vector3 felt_at(const Place&) const noexcept;
  double stored_at(const Place&) const noexcept;
  void blend_from(const Vector3& before_n_m, const Vector3& position_m) noexcept;

  KalmanOptions options_;
  State state_ = State::Zero();
  Eigen::Matrix4d covariance_ = Eigen::Matrix4d::Zero();
  bool known_ = false;                  // an answer with a force has been believed
  Vector3 anchor_m_ = Vector3::Zero();  // scene coordinates: it stays where it is when the frame turns
  double anchor_indentation_m_ = 0;
  double anchor_time_s_ = 0;
  TouchedSurface surface_;
  ContactFrame frame_;
  double gain_ = 0;
  PaidBlend blend_;
  double rendered_s_ = 0;
  int consecutive_outliers_ = 0;
  std::uint64_t outliers_ = 0;
};

}  // namespace teletact::client
