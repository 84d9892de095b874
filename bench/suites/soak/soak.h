// What the soak's clients do beside each other, and what they met.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "bench/service.h"
#include "client/acquire/frame_source.h"

namespace teletact::bench::soak {

// How calls ended, by the canonical code's name.
using Ends = std::map<std::string, std::uint64_t>;

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

// A client that publishes a window of its own scene again and again, each to be done within a time.
class FairImager {
 public:
  FairImager(const Service&, std::string name, std::string scene_id,
             const std::vector<client::FramePair>& pairs, double every_s, double finish_within_s,
             const Pause&);
  ~FairImager();
  void stop();

  // After stop().
  struct Windows {
    std::vector<double> published_s;  // since the last RF byte, in time
    std::vector<double> refused_s;    // since the last RF byte: at once
    std::vector<double> late_s;       // neither
  };
  const Windows& windows() const { return windows_; }
  const Statuses& statuses() const { return statuses_; }
  const std::string& name() const { return name_; }

 private:
  void run(const Service&, const std::vector<client::FramePair>& pairs, const Pause&);
  const std::string name_, scene_id_;
  const double every_s_, finish_within_s_;
  Windows windows_;
  Statuses statuses_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

// A client of its own name that does one thing wrong, over and over, until it goes out of scope.
struct Rogue {
  Statuses statuses;
  std::atomic<bool> stop{false};
  std::vector<std::jthread> threads;  // joined first
  ~Rogue() { stop = true; }
};

// As many long calls as it is given, alternating the largest strain.
std::unique_ptr<Rogue> start_greedy(const Service&, const std::string& scene_id,
                                    const std::vector<client::FramePair>& pairs, const Pause&);
// Touches, watches and uploads, and reads nothing of what comes back.
std::unique_ptr<Rogue> start_never_reading(const Service&, const std::string& scene_id,
                                           const client::FramePair& pair);
// Its connection is reset every second, with a touch, a watch and half an upload going on.
std::unique_ptr<Rogue> start_dying(const Service&, const std::string& scene_id,
                                   const client::FramePair& pair);

}  // namespace teletact::bench::soak
