#include "client/link/touch_answers.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>

#include "client/clock/clock.h"
#include "client/link/servo_messages.h"
#include "client/text/shown.h"

namespace teletact::client {
namespace {

constexpr double kLongestPeriodS = 10;

// A stay or a clock that no service has would overflow the sums.
bool plausible_stamps(const v1::TouchAnswer& answer) {
  constexpr std::int64_t kLongestStayNs = 3'600'000'000'000, kLatestNs = std::int64_t{1} << 61;
  const auto within = [](std::int64_t value, std::int64_t most) { return value >= 0 && value <= most; };
  return within(answer.queued_ns(), kLongestStayNs) && within(answer.compute_ns(), kLongestStayNs) &&
         within(answer.answer_stamp().monotonic_ns(), kLatestNs) && answer.answer_stamp().monotonic_ns() > 0;
}

}  // namespace

std::string TouchAnswers::take_opened(const v1::TouchOpened& opened, std::int64_t received_ns) {
  constexpr double kFarthestM = 10;
  const auto problem = [](const char* field, const auto& value, const char* remedy) {
    return fmt::format("the service opened the stream with {} {}: {}", field, value, remedy);
  };
  if (!(opened.period_s() > 0 && opened.period_s() <= kLongestPeriodS))
    return problem("period_s", opened.period_s(), "it must be above 0 and at most 10 s");
  const auto surface = surface_from(opened.layer());
  if (!(std::abs(opened.layer().depth_m()) <= kFarthestM))
    return problem("layer.depth_m", opened.layer().depth_m(), "it must be within 10 m");
  if (!surface)
    return problem("layer.normal",
                   opened.layer().normal_size() > 3
                       ? fmt::format("of {} values", opened.layer().normal_size())
                       : fmt::format("{}", fmt::join(opened.layer().normal(), ", ")),
                   "it must be a unit vector");
  const v1::Region& covered = opened.covered();
  for (const double end_m : {covered.begin_x_m(), covered.end_x_m(), covered.begin_z_m(), covered.end_z_m()})
    if (!(std::abs(end_m) <= kFarthestM)) return problem("covered", end_m, "it must be within 10 m");
  if (opened.credit() < 1 || opened.credit() > Pacing::kMax)
    return problem("credit", opened.credit(), "it must be 1 to 256");
  stats.period_s = opened.period_s();
  pacing = Pacing(opened.period_s(), opened.credit());
  arrivals_ = ArrivalIntervals();
  arrivals_.add(received_ns);  // the first answer has come as far as from there
  surface_ = *surface;
  stats.layer_depth_m = opened.layer().depth_m();
  ++stats.streams;
  if (opened.instance() != service_instance_) {
    if (service_instance_ != 0) spdlog::warn("the service was restarted");
    service_instance_ = opened.instance();
    clock_offset_.reset();
    ++stats.instances;
  }
  if (stats.streams > 1) spdlog::info("touch stream open again, layer at {:.4f} m", stats.layer_depth_m);
  say_who_steers(opened.steers(), opened.steered_by());
  return "";
}

std::optional<ServoAnswer> TouchAnswers::take_answer(const v1::TouchAnswer& answer, bool ours,
                                                     std::int64_t sent_ns, std::int64_t received_ns) {
  ++stats.answers;
  auto converted = to_servo_answer(answer, surface_, stats.period_s, received_ns);
  if (!converted || !ours) {
    ++stats.dropped;
    return std::nullopt;
  }
  keep_period(answer.period_s());
  arrivals_.add(received_ns);
  converted->period_s = std::max(stats.period_s, arrivals_.expected_s());
  take_stamps(answer, sent_ns, *converted);
  say_how_far_away();
  say_what_it_warns_of(answer, received_ns);
  say_whether_prepared(answer);
  say_who_steers(answer.steers(), answer.steered_by());
  if (preparing_) ++stats.preparing;
  if (!converted->has_force && !preparing_) ++stats.failed;
  if (answer.status() == v1::TOUCH_STATUS_DEGRADED) ++stats.degraded;
  covered_ = converted->covered;
  if (!covered_) ++stats.not_covered;
  if (std::isfinite(answer.largest_strain()))
    stats.largest_strain = std::max(stats.largest_strain, answer.largest_strain());
  if (converted->sample.position_m != last_position_m_) {
    ++stats.distinct;
    stats.latencies_s.add(seconds(received_ns) - converted->sample.pose_time_s);
  }
  if (answer.has_solve() && v1::SolvePath_IsValid(answer.path())) ++stats.solved_by[answer.path()];
  if (answer.has_budget() && std::isfinite(answer.budget().half_width())) {
    stats.force_budget.add(answer.budget().half_width());
    add_terms(answer.budget(), stats.made_by);
    if (answer.budget().above() > stats.largest_above) stats.largest_above = answer.budget().above();
  }
  last_position_m_ = converted->sample.position_m;
  stats.last_version = answer.model_version();
  stats.last_answer_s = seconds(received_ns);
  if (stats.first_answer_s == 0) stats.first_answer_s = stats.last_answer_s;
  return converted;
}

// A busy service answers more seldom than it agreed to: what it is sent sooner costs it time and changes
// nothing.
void TouchAnswers::keep_period(double period_s) {
  if (!(period_s > 0 && period_s <= kLongestPeriodS)) return;  // an older service does not say
  stats.period_s = period_s;
  pacing.keep(period_s);
}

// The pose left at sent_ns, came to the service `queued` and `compute` before its answer left there.
void TouchAnswers::take_stamps(const v1::TouchAnswer& answer, std::int64_t sent_ns, ServoAnswer& converted) {
  if (answer.answer_stamp().instance() != service_instance_ || sent_ns == 0 || !plausible_stamps(answer))
    return;
  const std::int64_t left_ns = answer.answer_stamp().monotonic_ns();
  const std::int64_t stayed_ns = answer.queued_ns() + answer.compute_ns();
  const std::int64_t received_ns = converted.received_ns;
  clock_offset_.add({sent_ns, left_ns - stayed_ns, left_ns, received_ns});
  if (!clock_offset_.known()) return;
  converted.round_trip_s = clock_offset_.round_trip_s();
  converted.clock_offset_s = stats.clock_offset_s = clock_offset_.offset_s(received_ns);
  stats.clock_offset_error_s = clock_offset_.error_s(received_ns);
  if (answer.model_stamp().instance() == service_instance_)
    converted.modulus_time_s = seconds(answer.model_stamp().monotonic_ns()) - converted.clock_offset_s;
  const double round_trip_s = seconds(received_ns - sent_ns - stayed_ns);
  stats.round_trips_s.add(round_trip_s);
  if (round_trip_s >= 0) pacing.answered(answer.sequence(), round_trip_s, received_ns);
}

// What is not trusted is said once a second at most; what is only remarkable (status OK) once.
void TouchAnswers::say_what_it_warns_of(const v1::TouchAnswer& answer, std::int64_t received_ns) {
  constexpr std::int64_t kEveryNs = 1'000'000'000;
  constexpr std::size_t kLongest = 1000;
  if (answer.warning().empty() || answer.status() == v1::TOUCH_STATUS_PREPARING) return;
  if (answer.status() == v1::TOUCH_STATUS_OK) {
    if (!remarked_) spdlog::info("the service remarks: {}", shown(answer.warning(), kLongest));
    remarked_ = true;
  } else if (received_ns - warned_ns_ >= kEveryNs) {
    spdlog::warn("the service warns: {}", shown(answer.warning(), kLongest));
    warned_ns_ = received_ns;
  }
}

// What is felt is a round trip old: said once when that is much, and when it no longer is.
void TouchAnswers::say_how_far_away() {
  constexpr double kFarS = 0.1, kNearS = 0.08;
  const double round_trip_s = clock_offset_.round_trip_s();
  const bool far_away = round_trip_s > (far_away_ ? kNearS : kFarS);
  if (far_away && !far_away_)
    spdlog::warn(
        "the round trip is {:.0f} ms: where there is no contact law (--renderer law) the force is that of "
        "where the "
        "finger "
        "was then; move slowly",
        1e3 * round_trip_s);
  if (!far_away && far_away_) spdlog::info("the round trip is {:.0f} ms now", 1e3 * round_trip_s);
  far_away_ = far_away;
}

void TouchAnswers::say_whether_prepared(const v1::TouchAnswer& answer) {
  const bool preparing = answer.status() == v1::TOUCH_STATUS_PREPARING;
  if (preparing && !preparing_) spdlog::info("no force yet: the service prepares the touched layer's model");
  if (!preparing && preparing_) spdlog::info("the touched layer's model is prepared");
  preparing_ = preparing;
}

void TouchAnswers::say_who_steers(bool steers, const std::string& steered_by) {
  const std::string who = steers               ? "this hand steers the scene's probe"
                          : steered_by.empty() ? ""
                                               : "touching without steering: session '" + shown(steered_by) +
                                                     "' steers the probe";
  if (who == who_steers_) return;
  who_steers_ = who;
  spdlog::info("{}", who.empty() ? "no touch steers the scene's probe" : who);
}

}  // namespace teletact::client
