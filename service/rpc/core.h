// What the services share. Owned by Server.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <vector>

#include "service/access/access.h"
#include "service/base/limits.h"
#include "service/base/memory.h"
#include "service/base/paced_log.h"
#include "service/base/seconds.h"
#include "service/device/current_device.h"
#include "service/imaging_plane/imaging_plane.h"
#include "service/rpc/address.h"
#include "service/rpc/calls.h"
#include "service/rpc/connections.h"
#include "service/rpc/metrics.h"
#include "service/scene/scenes.h"
#include "service/touch_plane/touch_workers.h"

namespace teletact::service {

// Of each device: the smallest one says.
inline std::uint64_t min_memory_bytes(const std::vector<std::shared_ptr<Device>>& devices) {
  std::uint64_t least = UINT64_MAX;
  for (const auto& device : devices) least = std::min(least, device->info().global_memory_bytes);
  return least;
}

// What takes longer is told of in the log, by one line of calls and one of answers a pace.
struct SlowTimes {
  std::chrono::milliseconds call{1000}, answer{50}, pace{1000};
};

struct ServerOptions {
  ListenOptions listen;
  std::filesystem::path state_directory;  // empty: scenes end with the process
  bool standby = false;                   // make_ready() waits while another process has that folder
  // The device of this number, after it failed.
  std::function<std::shared_ptr<Device>(std::size_t number)> reopen = {};
  std::size_t at_once = 1;  // pairs that a device works on; 0: usual_at_once()
  Limits limits;
  ConnectionLimits connections;
  std::shared_ptr<const TouchModels> models = tissue_models();  // what scenes are touched on
  SlowTimes slow;
  Access::Now now = WallClock::now;  // by which access expires
  std::chrono::milliseconds access_look = FileWatch::kLook;
};

struct Core {
  std::deque<CurrentDevice> devices;
  CurrentDevice& device = devices.front();  // that touch uses
  const Limits limits;
  std::uint64_t instance = 0;  // random per process start
  std::chrono::steady_clock::time_point started = std::chrono::steady_clock::now();
  const std::shared_ptr<MemoryBudget> memory;
  const std::shared_ptr<const TouchModels> models;
  const std::shared_ptr<const Access> access;  // null: whoever calls may do everything
  SlowLog slow_calls, slow_answers;            // of a touch: beside the period of its stream
  Metrics metrics;
  Connections connections;  // none of a Unix socket
  Calls calls;
  Scenes scenes;
  ImagingPlane imaging;  // last but one: its threads use the rest
  TouchWorkers touch;    // last: the same

  // `tell`: as ImagingPlane's.
  Core(const std::vector<std::shared_ptr<Device>>& devices_, std::uint64_t instance_,
       const ServerOptions& options, std::function<void(bool works)> tell)
      : devices(devices_.begin(), devices_.end()),
        limits(resolved(options.limits, host_memory_bytes(), min_memory_bytes(devices_))),
        instance(instance_),
        memory(std::make_shared<MemoryBudget>(limits, devices.size())),
        models(options.models),
        access(options.listen.access.empty()
                   ? nullptr
                   : std::make_shared<const Access>(options.listen.access, options.now, options.access_look)),
        slow_calls("slow_call", options.slow.call, options.slow.pace),
        slow_answers("slow_answer", options.slow.answer, options.slow.pace),
        connections(options.connections),
        calls(limits),
        scenes(options.state_directory, limits, machine_files(), memory, models, options.standby),
        imaging(devices, options.at_once, scenes, memory, models, options.reopen, std::move(tell)),
        touch(limits) {}

  // In whose name memory is held.
  MemoryAccount account(std::string client, std::string scene = {}) const {
    return {memory, std::move(client), std::move(scene)};
  }
};

// CLOCK_MONOTONIC.
inline std::int64_t monotonic_ns(
    std::chrono::steady_clock::time_point at = std::chrono::steady_clock::now()) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(at.time_since_epoch()).count();
}

}  // namespace teletact::service
