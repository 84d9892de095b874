// What the ticks of a session add up to, of a size that does not grow with it. Fed by the thread that drains
// the telemetry.
#pragma once

#include <cstdint>
#include <vector>

#include "client/servo/histogram.h"
#include "client/servo/servo_loop.h"

namespace teletact::client {

// Spells of something that a tick says, and how long they were in all: each, or those longer than `longer_s`.
class SpellCounter {
 public:
  explicit SpellCounter(double longer_s = -1) : longer_s_(longer_s) {}
  void add(double time_s, bool on) noexcept;
  std::uint64_t count() const noexcept { return count_; }
  double seconds() const noexcept { return seconds_; }

 private:
  double longer_s_;
  bool on_ = false, counted_ = false;
  double begin_s_ = 0, last_s_ = 0;
  std::uint64_t count_ = 0;
  double seconds_ = 0;
};

// A stall is the hand held for longer than this at the border of what is covered.
inline constexpr double kStallS = 0.001;

// The value below which `share` (0 .. 1) of the values lie; 0 of none. Reorders them.
double percentile(std::vector<double>& values, double share);

struct StateChange {
  double time_s = 0;  // since the first tick
  ServoState state = ServoState::kDisabled;
  StateReason reason = StateReason::kStart;
};

class TickStatistics {
 public:
  static constexpr std::size_t kMaxChanges = 1000;
  TickStatistics() { changes_.reserve(kMaxChanges); }
  void add(const ServoTick& tick);

  std::uint64_t ticks() const noexcept { return ticks_; }
  double duration_s() const noexcept;
  double rate_hz() const noexcept;
  double enabled_s() const noexcept { return enabled_s_; }
  // While ENABLED: faded for age or energy or much withheld, not trusted by the service, faded by silence.
  const SpellCounter& degraded() const noexcept { return degraded_; }
  const SpellCounter& service_degraded() const noexcept { return service_degraded_; }
  const SpellCounter& faded() const noexcept { return faded_; }
  double by_law_share() const noexcept;                       // of the ticks with force, from a contact law
  double lost_s() const noexcept { return lost_s_; }          // PAUSED or in FAULT after force was on first
  double lost_now_s() const noexcept { return lost_now_s_; }  // of these, up to now at a stretch
  const ServoTick& last() const noexcept { return last_; }
  double largest_force_n() const noexcept { return largest_force_n_; }
  const EnergyLedger::Refused& largest_claim() const noexcept { return largest_claim_; }  // that was refused
  const SpellCounter& stalls() const noexcept { return stalls_; }
  const Histogram& lateness_s() const noexcept { return lateness_s_; }
  const Histogram& period_s() const noexcept { return period_s_; }        // from tick to tick
  const Histogram& slack_s() const noexcept { return slack_s_; }          // left of each period
  const Histogram& model_age_s() const noexcept { return model_age_s_; }  // while ENABLED with an answer
  // The first of them, and how many came after these.
  const std::vector<StateChange>& changes() const noexcept { return changes_; }
  std::uint64_t changes_left_out() const noexcept { return changes_left_out_; }

 private:
  std::uint64_t ticks_ = 0;
  std::int64_t first_ns_ = 0;
  ServoTick last_;
  double enabled_s_ = 0;
  SpellCounter degraded_;
  SpellCounter service_degraded_;
  SpellCounter faded_;
  std::uint64_t with_force_ = 0, by_law_ = 0;
  double lost_s_ = 0;
  double lost_now_s_ = 0;
  double largest_force_n_ = 0;
  EnergyLedger::Refused largest_claim_;
  SpellCounter stalls_{kStallS};
  Histogram lateness_s_;
  Histogram period_s_;
  Histogram slack_s_;
  Histogram model_age_s_;
  std::vector<StateChange> changes_;
  std::uint64_t changes_left_out_ = 0;
};

}  // namespace teletact::client
