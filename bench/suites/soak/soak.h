// What the soak's clients do beside each other, and what they met.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "bench/imager.h"
#include "bench/service.h"

namespace teletact::bench::soak {

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
