// What the service has done since it started, in Prometheus's terms. No client, scene or session is a label:
// there is no end of them. Thread-safe; whoever counts waits for nobody, nor for whoever reads.
#pragma once

#include <prometheus/counter.h>
#include <prometheus/registry.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include "service/imaging_plane/imaging_plane.h"
#include "service/touch_plane/touch_stream.h"

namespace teletact::service {

// Times by their size. prometheus::Histogram takes a lock: touch would wait for a scrape.
class SecondsHistogram {
 public:
  explicit SecondsHistogram(std::vector<double> bounds_s);  // increasing
  void observe(double seconds);
  prometheus::ClientMetric collect() const;

 private:
  const std::vector<double> bounds_s_;
  std::vector<std::atomic<std::uint64_t>> times_;  // one more: beyond the last bound
  std::atomic<double> sum_s_{0};
};

class Metrics {
 public:
  Metrics();
  // A pose of a touch stream has come, and another one that had not been answered went for it.
  void pose(bool replaced);
  // An answer was handed to gRPC.
  void answer(const TouchStream::Answered&);
  void law_piece() { law_pieces_.Increment(); }
  void observation() { observations_.Increment(); }
  void estimate(const EstimateOutcome&);
  std::vector<prometheus::MetricFamily> collect() const;

 private:
  prometheus::Registry counters_;
  prometheus::Counter &poses_, &replaced_, &law_pieces_, &observations_;
  std::array<prometheus::Counter*, 5> answers_;  // by TouchStatus
  SecondsHistogram queued_, computed_, pose_age_;
  std::array<SecondsHistogram, 7> estimate_stages_;
};

}  // namespace teletact::service
