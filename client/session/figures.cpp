#include "client/session/figures.h"

namespace teletact::client {

double spent_s(const TickStatistics& ticks, double lost_s) {
  return ticks.enabled_s() + (ticks.lost_now_s() >= lost_s ? ticks.lost_s() : 0);
}

double touch_rate_hz(const TouchLinkStats& link) {
  const double span_s = link.last_answer_s - link.first_answer_s;
  return span_s > 0 ? static_cast<double>(link.distinct) / span_s : 0;
}

v1::RecordEntry to_record(const TouchSummary& summary, std::int64_t now_ns) {
  const TickStatistics& ticks = summary.ticks;
  const TouchLinkStats& link = summary.link;
  v1::RecordEntry entry;
  entry.set_monotonic_ns(now_ns);
  v1::SessionFigures& out = *entry.mutable_figures();
  out.set_duration_s(ticks.duration_s());
  out.set_enabled_s(ticks.enabled_s());
  out.set_ticks(ticks.ticks());
  out.set_rate_hz(ticks.rate_hz());
  out.set_overruns(summary.overruns);
  out.set_lateness_p50_s(ticks.lateness_s().percentile(0.5));
  out.set_lateness_p99_s(ticks.lateness_s().percentile(0.99));
  out.set_lateness_max_s(ticks.lateness_s().percentile(1));
  out.set_touch_rate_hz(touch_rate_hz(link));
  out.set_latency_p50_s(link.latencies_s.percentile(0.5));
  out.set_latency_p99_s(link.latencies_s.percentile(0.99));
  out.set_latency_max_s(link.latencies_s.percentile(1));
  out.set_round_trip_p50_s(link.round_trips_s.percentile(0.5));
  out.set_round_trip_p99_s(link.round_trips_s.percentile(0.99));
  out.set_model_age_p99_s(ticks.model_age_s().percentile(0.99));
  out.set_by_law_share(ticks.by_law_share());
  out.set_stalls(ticks.stalls().count());
  out.set_stalls_s(ticks.stalls().seconds());
  out.set_largest_force_n(ticks.largest_force_n());
  out.set_degraded_s(ticks.degraded().seconds());
  out.set_faded_s(ticks.faded().seconds());
  out.set_lost_s(ticks.lost_s());
  out.set_answers(link.answers);
  out.set_not_covered(link.not_covered);
  out.set_degraded(link.degraded);
  out.set_failed(link.failed);
  out.set_streams(link.streams);
  out.set_service_instances(link.instances);
  out.set_law_pieces(link.law_pieces);
  out.set_tactile_images(link.tactile_images);
  out.set_budget_p50(link.force_budget.percentile(0.5));
  out.set_budget_p95(link.force_budget.percentile(0.95));
  out.set_telemetry_dropped(summary.telemetry_dropped);
  return entry;
}

}  // namespace teletact::client
