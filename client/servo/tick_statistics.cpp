#include "client/servo/tick_statistics.h"

#include <algorithm>
#include <cmath>

#include "client/clock/clock.h"

namespace teletact::client {

void SpellCounter::add(double time_s, bool on) noexcept {
  if (on && !on_) {
    begin_s_ = last_s_ = time_s;
    counted_ = false;
  }
  if (counted_ && on_) {  // the first tick without it still ends the spell: it lasted until now
    seconds_ += time_s - last_s_;
  } else if ((on || on_) && time_s - begin_s_ > longer_s_) {
    counted_ = true;
    ++count_;
    seconds_ += time_s - begin_s_;
  }
  on_ = on;
  last_s_ = time_s;
}

double percentile(std::vector<double>& values, double share) {
  if (values.empty()) return 0;
  const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(values.size())));
  const auto index = std::clamp<std::size_t>(rank, 1, values.size()) - 1;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(index), values.end());
  return values[index];
}

void TickStatistics::add(const ServoTick& tick) {
  const bool changed = ticks_ == 0 || tick.state != last_.state || tick.reason != last_.reason;
  if (ticks_ == 0) first_ns_ = tick.time_ns;
  const double time_s = seconds(tick.time_ns - first_ns_);
  if (ticks_ > 0) {
    const double step_s = seconds(tick.time_ns - last_.time_ns);
    if (last_.state == ServoState::kEnabled) {
      enabled_s_ += step_s;
      lost_now_s_ = 0;
    } else if (enabled_s_ > 0 && last_.state != ServoState::kDisabled) {  // an end that was asked for
      lost_s_ += step_s;
      lost_now_s_ += step_s;
    }
    period_s_.add(step_s);
    slack_s_.add(tick.slack_s);
  }
  if (changed && changes_.size() < kMaxChanges)
    changes_.push_back({time_s, tick.state, tick.reason});
  else if (changed)
    ++changes_left_out_;
  const bool enabled = tick.state == ServoState::kEnabled;
  degraded_.add(time_s, enabled && tick.degraded);
  service_degraded_.add(time_s, enabled && tick.service_degraded);
  faded_.add(time_s, enabled && tick.faded);
  stalls_.add(time_s, tick.held_at_border);
  if (tick.force_n.squaredNorm() > 0) ++with_force_, by_law_ += tick.by_law;
  largest_force_n_ = std::max(largest_force_n_, tick.force_n.norm());
  if (tick.refused.lacks_j > largest_claim_.lacks_j) largest_claim_ = tick.refused;
  lateness_s_.add(tick.lateness_s);
  if (enabled && tick.sequence != 0) model_age_s_.add(tick.model_age_s);
  last_ = tick;
  ++ticks_;
}

double TickStatistics::duration_s() const noexcept {
  return ticks_ == 0 ? 0 : seconds(last_.time_ns - first_ns_);
}

double TickStatistics::by_law_share() const noexcept {
  return with_force_ == 0 ? 0 : static_cast<double>(by_law_) / static_cast<double>(with_force_);
}

double TickStatistics::rate_hz() const noexcept {
  const double duration = duration_s();
  return duration > 0 ? static_cast<double>(ticks_ - 1) / duration : 0;
}

}  // namespace teletact::client
