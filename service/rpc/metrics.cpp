#include "service/rpc/metrics.h"

#include <algorithm>
#include <chrono>
#include <limits>
#include <string>
#include <utility>

namespace teletact::service {
namespace {

std::vector<double> touch_bounds_s() {
  return {5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5, 1};
}

SecondsHistogram estimate_stage() {
  return SecondsHistogram({1e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60});
}

// By TouchStatus.
constexpr std::array<const char*, 5> kStatusNames{"ok", "not_covered", "degraded", "failed", "preparing"};
constexpr std::array<const char*, 7> kEstimateStages{"queued",  "waited",  "displacement",         "strain",
                                                     "modulus", "publish", "received_to_published"};

double seconds_of(std::chrono::steady_clock::duration duration) {
  return std::chrono::duration<double>(duration).count();
}

prometheus::Counter& counter(prometheus::Registry& registry, const char* name, const char* help) {
  return prometheus::BuildCounter().Name(name).Help(help).Register(registry).Add({});
}

auto answers(prometheus::Registry& registry) {
  auto& family = prometheus::BuildCounter()
                     .Name("teletact_touch_answers_total")
                     .Help("Answers to poses, by status")
                     .Register(registry);
  std::array<prometheus::Counter*, kStatusNames.size()> out{};
  for (std::size_t k = 0; k < out.size(); ++k) out[k] = &family.Add({{"status", kStatusNames[k]}});
  return out;
}

// `stage`: none for a family of one.
void add(prometheus::MetricFamily& family, const SecondsHistogram& histogram, const char* stage = nullptr) {
  prometheus::ClientMetric metric = histogram.collect();
  if (stage) metric.label = {{"stage", stage}};
  family.metric.push_back(std::move(metric));
}

}  // namespace

SecondsHistogram::SecondsHistogram(std::vector<double> bounds_s)
    : bounds_s_(std::move(bounds_s)), times_(bounds_s_.size() + 1) {}

void SecondsHistogram::observe(double seconds) {
  const auto bucket = std::lower_bound(bounds_s_.begin(), bounds_s_.end(), seconds) - bounds_s_.begin();
  times_[static_cast<std::size_t>(bucket)].fetch_add(1, std::memory_order_relaxed);
  sum_s_.fetch_add(seconds, std::memory_order_relaxed);
}

prometheus::ClientMetric SecondsHistogram::collect() const {
  prometheus::ClientMetric metric;
  std::uint64_t so_far = 0;
  for (std::size_t k = 0; k < times_.size(); ++k) {
    so_far += times_[k].load(std::memory_order_relaxed);
    const double bound_s = k < bounds_s_.size() ? bounds_s_[k] : std::numeric_limits<double>::infinity();
    metric.histogram.bucket.push_back({so_far, bound_s});
  }
  metric.histogram.sample_count = so_far;
  metric.histogram.sample_sum = sum_s_.load(std::memory_order_relaxed);
  return metric;
}

Metrics::Metrics()
    : poses_(counter(counters_, "teletact_touch_poses_total", "Poses of touch streams")),
      replaced_(counter(counters_, "teletact_touch_poses_replaced_total",
                        "Poses in whose place a newer one was answered")),
      law_pieces_(counter(counters_, "teletact_touch_law_pieces_total", "Pieces of contact laws sent")),
      observations_(
          counter(counters_, "teletact_observe_states_total", "States sent to observers of scenes")),
      answers_(answers(counters_)),
      queued_(touch_bounds_s()),
      computed_(touch_bounds_s()),
      pose_age_(touch_bounds_s()),
      estimate_stages_{estimate_stage(), estimate_stage(), estimate_stage(), estimate_stage(),
                       estimate_stage(), estimate_stage(), estimate_stage()} {}

void Metrics::pose(bool replaced) {
  poses_.Increment();
  if (replaced) replaced_.Increment();
}

void Metrics::answer(const TouchStream::Answered& answered) {
  answers_.at(static_cast<std::size_t>(answered.answer.status))->Increment();
  queued_.observe(seconds_of(answered.queued));
  computed_.observe(seconds_of(answered.computing));
  pose_age_.observe(seconds_of(answered.queued + answered.computing));
}

void Metrics::estimate(const EstimateOutcome& outcome) {
  const Estimate& e = outcome.estimate;
  const std::array<double, kEstimateStages.size()> times_s{outcome.queued_s,
                                                           outcome.waited_s,
                                                           e.displacement_s,
                                                           e.strain_s,
                                                           e.modulus_s,
                                                           outcome.publish_s,
                                                           outcome.received_to_published_s};
  constexpr std::size_t kWithoutScene = 5;
  const std::size_t stages = outcome.published ? times_s.size() : kWithoutScene;
  for (std::size_t k = 0; k < stages; ++k) estimate_stages_[k].observe(times_s[k]);
}

std::vector<prometheus::MetricFamily> Metrics::collect() const {
  using prometheus::MetricType;
  auto families = counters_.Collect();
  auto& touch = families.emplace_back(prometheus::MetricFamily{
      "teletact_touch_stage_seconds", "Of an answer, by stage", MetricType::Histogram, {}});
  add(touch, queued_, "queued"), add(touch, computed_, "computed");
  add(families.emplace_back(
          prometheus::MetricFamily{"teletact_touch_pose_age_seconds",
                                   "From a pose's arrival until its answer is handed to the transport",
                                   MetricType::Histogram,
                                   {}}),
      pose_age_);
  auto& estimate = families.emplace_back(prometheus::MetricFamily{
      "teletact_estimate_stage_seconds", "Of an estimate, by stage", MetricType::Histogram, {}});
  for (std::size_t k = 0; k < kEstimateStages.size(); ++k)
    add(estimate, estimate_stages_[k], kEstimateStages[k]);
  return families;
}

}  // namespace teletact::service
