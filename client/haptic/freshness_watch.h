// Whether a device's positions are of now, judged by what they say and not by when they come: a sensor that
// has stopped, or a driver that repeats itself, goes on sending. A position that stands still to the last bit
// for kStandsS is frozen
//   - when the stated velocity says that it moved meanwhile;
//   - under force, when the tool turned meanwhile;
//   - under force, in any case: no hand holds so still, and what noise a device has goes on.
// The last does not hold for a device within whose steps a hand may rest: one that is said to have no noise,
// or that has shown coarse steps with stands between them.
//
// Times are the caller's. Samples that come late count as kLateS apart: a stall is no stand.
#pragma once

#include <cstdint>
#include <optional>

#include "client/render/renderer.h"

namespace teletact::client {

enum class Freshness : std::uint8_t { kFresh, kAgainstVelocity, kAgainstOrientation, kStandsStill };
const char* describe(Freshness) noexcept;  // of one that is not fresh

struct FreshnessSample {
  Vector3 position_m = Vector3::Zero();
  std::optional<Vector3> velocity_m_s;         // that the device states; not one derived from its positions
  std::optional<Eigen::Vector4d> orientation;  // unit quaternion of the tool
  bool under_force = false;                    // the hand feels something
};

class FreshnessWatch {
 public:
  static constexpr double kStandsS = 0.1;
  static constexpr double kLateS = 0.01;
  static constexpr double kWayM = 3e-4;     // that the velocity may say of a stand of at most 0.1 s
  static constexpr double kTurnRad = 0.09;  // that a tool may turn meanwhile, in place: 5 degrees
  static constexpr double kFineM = 1e-5;    // what moves by less is no coarse step
  static constexpr double kSlowM_S = 0.02;  // what moves faster tells nothing of its steps

  explicit FreshnessWatch(bool has_noise = true) : has_noise_(has_noise) {}
  void restart() noexcept { *this = FreshnessWatch(has_noise_); }
  Freshness judge(std::int64_t now_ns, const FreshnessSample& sample) noexcept;

 private:
  static constexpr double kHalfS = kStandsS / 2;
  // What the device said within a half of kStandsS.
  struct Half {
    double length_s = 0;
    Vector3 way_m = Vector3::Zero();
    std::optional<Eigen::Vector4d> begins;
  };

  void learn(double step_m) noexcept;
  void stand(const FreshnessSample& sample, double elapsed_s) noexcept;
  bool is_coarse() const noexcept;
  bool turned(const FreshnessSample& sample) const noexcept;

  bool has_noise_;
  std::optional<Vector3> position_m_;
  std::int64_t last_ns_ = 0;
  double stands_s_ = 0;
  unsigned stood_ = 0;                   // samples that said the same as the one before
  Half earlier_, current_;               // of this stand
  std::uint64_t fine_ = 0, coarse_ = 0;  // steps so far
};

}  // namespace teletact::client
