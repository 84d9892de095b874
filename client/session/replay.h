// Plays a recording again through a service and compares what it answers with what it answered then.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include "client/link/credentials.h"
#include "client/link/recording.h"

namespace teletact::client {

struct ReplayOptions {
  std::string path;
  std::string address;
  Credentials credentials;
  std::string scene_id;     // empty: the recorded one
  double speed = 1;         // of the recorded timing; 0 = as fast as the service answers
  std::string record_path;  // record the replay; empty: no
};

struct ReplayReport {
  std::string kind;  // "touch" or "acquire"
  bool truncated = false;
  std::uint64_t calls = 0;      // touch streams or Estimate calls played
  std::uint64_t requests = 0;   // poses or pairs
  std::uint64_t compared = 0;   // answers, or maps, that have a recorded partner
  std::uint64_t not_alike = 0;  // other status or shape, no number, or none at all
  std::uint64_t forces = 0;     // answers of which both have a force
  std::uint64_t alone = 0;      // slices of solids, estimated without their neighbours and not compared
  // Touch: |F - F_recorded|, its largest, with the recorded force there and where it was.
  double largest_force_difference_n = 0;
  double recorded_force_n = 0;
  double largest_at_x_m = 0;
  // Acquire: largest |value - recorded| over the largest |recorded| of a map, and which.
  double largest_map_difference = 0;
  std::string largest_map;
};

// One line; "" where all is as it was recorded.
std::string what_is_not_alike(const ReplayReport& report);

// Throws std::runtime_error with one line: unreadable recording, no service, unknown scene, a call refused.
ReplayReport replay(const ReplayOptions& options, const std::atomic<bool>& stop);

}  // namespace teletact::client
