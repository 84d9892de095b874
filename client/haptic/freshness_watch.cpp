#include "client/haptic/freshness_watch.h"

#include <algorithm>
#include <cmath>

#include "client/clock/clock.h"

namespace teletact::client {

const char* describe(Freshness freshness) noexcept {
  switch (freshness) {
    case Freshness::kFresh:
      return "it is fresh";
    case Freshness::kAgainstVelocity:
      return "its position stands still while its velocity says that it moves";
    case Freshness::kAgainstOrientation:
      return "its position stands still while its orientation turns";
    case Freshness::kStandsStill:
      return "its position stands still to the last bit in a hand that is pushed; if its "
             "positions have no noise, give --device-without-noise";
  }
  return "?";
}

Freshness FreshnessWatch::judge(std::int64_t now_ns, const FreshnessSample& sample) noexcept {
  const double elapsed_s = std::clamp(seconds(now_ns - last_ns_), 0.0, kLateS);
  last_ns_ = now_ns;
  if (!position_m_ || sample.position_m != *position_m_) {
    if (position_m_) learn((sample.position_m - *position_m_).norm());
    position_m_ = sample.position_m;
    stands_s_ = 0;
    stood_ = 0;
    earlier_ = {};
    current_ = {.begins = sample.orientation};
    return Freshness::kFresh;
  }
  stand(sample, elapsed_s);
  if (stands_s_ < kStandsS) return Freshness::kFresh;
  if (!((earlier_.way_m + current_.way_m).norm() <= kWayM)) return Freshness::kAgainstVelocity;
  if (!sample.under_force) return Freshness::kFresh;
  if (turned(sample)) return Freshness::kAgainstOrientation;
  return has_noise_ && !is_coarse() ? Freshness::kStandsStill : Freshness::kFresh;
}

// A step that ends a stand of several samples, by a device that moves slowly, is one of its own.
void FreshnessWatch::learn(double step_m) noexcept {
  constexpr unsigned kStood = 3;
  if (step_m < kFineM)
    ++fine_;
  else if (stood_ >= kStood && step_m < kSlowM_S * stands_s_)
    ++coarse_;
}

void FreshnessWatch::stand(const FreshnessSample& sample, double elapsed_s) noexcept {
  ++stood_;
  stands_s_ += elapsed_s;
  if (current_.length_s >= kHalfS) {
    earlier_ = current_;
    current_ = {.begins = sample.orientation};
  }
  current_.length_s += elapsed_s;
  if (sample.velocity_m_s) current_.way_m += elapsed_s * *sample.velocity_m_s;
}

bool FreshnessWatch::is_coarse() const noexcept {
  constexpr std::uint64_t kEnough = 10, kTimesFine = 20;
  return coarse_ >= kEnough && coarse_ > kTimesFine * fine_;
}

bool FreshnessWatch::turned(const FreshnessSample& sample) const noexcept {
  if (!earlier_.begins || !sample.orientation) return false;
  const double cosine = std::abs(earlier_.begins->dot(*sample.orientation));  // of half the angle
  return 2 * std::acos(std::min(cosine, 1.0)) > kTurnRad;
}

}  // namespace teletact::client
