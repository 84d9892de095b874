// A client that images: it publishes windows of RF, each to be done within a time.
#pragma once

#include <grpcpp/channel.h>

#include <atomic>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "bench/run_suite.h"
#include "bench/service.h"
#include "client/acquire/estimate_client.h"
#include "client/acquire/frame_source.h"
#include "client/patient/tissue.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::bench {

// 120 mm with one inclusion, and RF pairs of its windows of 30 mm, one beside the other.
client::Tissue imaged_tissue();
std::vector<client::FramePair> imaged_pairs(const client::Tissue&);
// An empty one to publish into.
void create_imaged_scene(v1::Palpation::Stub&, const std::string& id, const client::Tissue&);
// Of a pair, into a scene at a place.
v1::Acquisition published(const client::FramePair&, const std::string& scene_id, double window_x_m);

// How calls ended, by the canonical code's name.
using Ends = std::map<std::string, std::uint64_t>;
// "DEADLINE_EXCEEDED" of "Estimate: DEADLINE_EXCEEDED: ..."
std::string code_in(const client::ServiceError&);

// Of one client. Thread-safe.
class Statuses {
 public:
  void add(const std::string& code) {
    const std::lock_guard lock(mutex_);
    ++counts_[code];
  }
  Ends counts() const {
    const std::lock_guard lock(mutex_);
    return counts_;
  }

 private:
  mutable std::mutex mutex_;
  Ends counts_;
};

// What is said to every client that images: while it is set, none begins a window.
using Pause = std::atomic<bool>;

// Windows of one client.
struct WindowFigures {
  std::string name;
  std::size_t published = 0, refused = 0, late = 0;
  Quantiles published_s{}, refused_s{};  // counts of 0 where there was none
  std::vector<double> late_s{};
  Ends ends{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(WindowFigures, name, published, refused, late, published_s, refused_s,
                                   late_s, ends)
// "name: 3 windows in time, 0 refused at once, 0 late; ends: OK 3"
std::string line_of(const WindowFigures&);
std::string text_of(const Ends&);

// Publishes windows of a scene of its own, again and again.
class Imager {
 public:
  Imager(const Service&, std::string name, std::string scene_id, const std::vector<client::FramePair>& pairs,
         double every_s, double finish_within_s, const Pause&);
  ~Imager();
  void stop();
  WindowFigures windows() const;  // after stop()

 private:
  void run(const Service&, const std::vector<client::FramePair>& pairs, const Pause&);
  const std::string name_, scene_id_;
  const double every_s_, finish_within_s_;
  // Since the last RF byte: in time, refused at once, neither.
  std::vector<double> published_s_, refused_s_, late_s_;
  Statuses statuses_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace teletact::bench
