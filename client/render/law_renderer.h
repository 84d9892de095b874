// Renders the tissue's contact law (T7): F = -grad Phi at every tick, whatever the network does. Phi is a
// soft minimum of the law's energy U and of a spring of the display's largest stiffness, and goes on straight
// from where the display's largest force is reached. A cap on the force would itself be active (pressed on an
// inclusion, slid off it and let go, it gives back half of what it holds); of a potential nothing can be had.
//
// Answers of the version that is rendered only check it. Where there is no law, where answers are of a newer
// version, or where the law was found wrong, the Kalman filter's model is felt, as without laws. From one to
// the other, from a law to a newer one, and from the filter's model to that of another version or of another
// model of the service, what is felt changes no faster than by 7 % in 10 ms, and no harder than is paid for
// (potential_blend.h).
#pragma once

#include <array>
#include <limits>

#include "client/render/force_limits.h"
#include "client/render/kalman_renderer.h"
#include "client/render/near_law.h"
#include "client/render/potential_blend.h"

namespace teletact::client {

struct LawRendererOptions {
  KalmanOptions kalman = {};
  // Of the display; in Phi each a little lower, so that the soft minimum's force stays below.
  double largest_force_n = ForceLimits{}.largest_force_n;
  double largest_stiffness_n_m = ForceLimits{}.largest_stiffness_n_m;
  // An answer contradicts the law when its force is off by more than what the law states; one of the place of
  // the contradiction before, by more than this much of it: what a finger at rest says again is one answer.
  double contradicts_again = 2, place_m = 0.001;
  int contradictions_in_a_row = 4;  // and the law is dropped
};

class LawRenderer final : public Renderer {
 public:
  explicit LawRenderer(const LawRendererOptions& options = {})
      : options_(options),
        kalman_(options.kalman),
        blend_({.servo_period_s = options.kalman.blend.servo_period_s}) {}
  void reset() noexcept override;
  bool update(const ForceSample& sample, const ToolPose& pose, double time_s) noexcept override;
  void take_law(const NearLaw& law) noexcept override;
  using Renderer::render;
  Rendered render(const ToolPose& pose, double time_s, EnergyLedger& ledger) noexcept override;

  std::uint64_t dropped() const noexcept { return dropped_; }  // laws found wrong

 private:
  LawValue law_at(const Vector3& position_m) const noexcept;
  bool trusted(const LawValue&) const noexcept;
  Potential softened(const LawValue&, double indentation_m) const noexcept;
  Potential potential(const LawValue&, const Vector3& position_m, double indentation_m) const noexcept;
  Vector2 along_m() const noexcept;
  bool wrong(std::uint64_t version) const noexcept;
  void judge_age() noexcept;
  void check(const ForceSample&) noexcept;

  LawRendererOptions options_;
  KalmanRenderer kalman_;
  PotentialBlend blend_;
  NearLaw law_;
  // Where the newest answer was computed, and with which version (0: none); nowhere on a new stream.
  Vector3 answered_m_ = Vector3::Constant(std::numeric_limits<double>::quiet_NaN());
  std::uint64_t answered_version_ = 0;
  std::uint32_t solved_by_ = 0;  // the newest answer in contact
  bool stale_ = false;           // the law is of an older one there
  // Found wrong on this stream: not rendered. The newest of them; 0: none.
  std::array<std::uint64_t, 8> wrong_{};
  TouchedSurface surface_;
  int contradictions_ = 0;  // in a row, of this version:
  std::uint64_t contradicted_ = 0;
  Vector3 contradicted_m_ = Vector3::Zero();  // place of the last
  std::uint64_t dropped_ = 0;
  bool by_law_ = false;                   // the last tick was
  Potential model_, felt_;                // at it; in the air: nothing
  Vector3 position_m_ = Vector3::Zero();  // of it
  double rendered_s_ = 0;
};

}  // namespace teletact::client
