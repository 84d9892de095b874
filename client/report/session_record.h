// What a touch and an acquire recording of one session say, as plain series; times are CLOCK_MONOTONIC
// seconds of the machine that recorded, so both recordings must come from the same machine (and boot) to be
// related.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "client/link/tactile_image.h"
#include "client/patient/patient.h"
#include "client/render/energy_ledger.h"
#include "teletact/v1/recording.pb.h"

namespace teletact::client {

struct TouchTick {
  double time_s = 0;
  double x_m = 0, indentation_m = 0, z_m = 0;  // of the device's tip; indentation from the touched layer
  double force_x_n = 0, force_y_n = 0, force_z_n = 0;  // written to the device
  double lateness_s = 0;
  bool enabled = false;
  bool at_border = false;
  double round_trip_s = 0;  // of the link, without the service's own time; 0: not known
  std::optional<bool> degraded, service_degraded, faded, by_law;  // absent in recordings of earlier versions
  std::optional<EnergyLedger::Refused> refused;                   // these too
};

// That an answer states for the true force: [1 - half_width, 1 + half_width + above] times its own.
struct ForceInterval {
  double half_width = 0, above = 0;
  bool operator==(const ForceInterval&) const = default;
};

struct TouchAnswerTime {
  double arrived_s = 0;
  double latency_s = 0;              // since the pose was sampled
  double x_m = 0, y_m = 0, z_m = 0;  // the pose that was answered
  std::array<double, 3> force_n{};   // on the finger
  std::optional<ForceInterval> stated{};
};

struct TactileFrame {
  double arrived_s = 0;
  TactileImage image;
};

struct TouchRecord {
  Finger finger;
  std::string untold;  // why the true force under this tip is not known; empty: it is
  double layer_depth_m = 0;
  std::string scene_id;
  std::vector<TouchTick> ticks;
  std::vector<TouchAnswerTime> answers;
  std::vector<TactileFrame> tactile;
  std::uint64_t malformed_images = 0;  // left out
  std::uint64_t not_covered = 0, degraded = 0, failed = 0;
  std::uint64_t model_version = 0;    // newest of the answers
  std::set<std::uint64_t> instances;  // of the service, as its streams were opened
};

struct AcquiredWindow {
  double x_m = 0, published_s = 0;
  double request_s = 0;                // asked for to published
  double received_to_published_s = 0;  // as the service measured it; of a slice, as the client did
  double z_m = 0;                      // of a slice
};

struct AcquireRecord {
  std::string scene_id;
  std::vector<AcquiredWindow> windows;
  std::optional<teletact::v1::Scene> scene;           // as it stood at the end
  std::optional<teletact::v1::GetInfoResponse> info;  // what ran at the other end
};

// Both throw std::runtime_error with one line: unreadable, damaged, or of the other kind.
TouchRecord read_touch_record(const std::string& path);
AcquireRecord read_acquire_record(const std::string& path);

// Half of the interval that was stated for the force of a tick, over the force: by the newest answer that had
// come by then, if it is of this touch. None: it states nothing, or is of another place.
std::optional<ForceInterval> stated_interval(const TouchRecord&, const TouchTick&);

// Why the two may not belong to one session, one line; empty when nothing speaks against it. Throws
// std::runtime_error when they cannot: other scenes, or all windows published after the touch had ended.
std::string session_mismatch(const TouchRecord& touch, const AcquireRecord& acquire);

}  // namespace teletact::client
