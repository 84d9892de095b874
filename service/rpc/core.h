// What the services share. Owned by Server.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>

#include "service/device/device.h"
#include "service/rpc/calls.h"
#include "service/scene/scenes.h"

namespace teletact::service {

struct Core {
  static constexpr std::uint64_t kMostFrameBytes = 64ULL << 20;  // one RF frame
  static constexpr std::size_t kMostChunkBytes = 1U << 20;
  static constexpr double kMostTouchesPerSecond = 1000;

  std::shared_ptr<Device> device;
  std::uint64_t instance = 0;  // random per process start
  std::chrono::steady_clock::time_point started = std::chrono::steady_clock::now();
  Calls calls;
  Scenes scenes;

  Core(std::shared_ptr<Device> device_, std::uint64_t instance_, const std::filesystem::path& state_directory)
      : device(std::move(device_)), instance(instance_), scenes(state_directory) {}
};

// CLOCK_MONOTONIC.
inline std::int64_t monotonic_ns(
    std::chrono::steady_clock::time_point at = std::chrono::steady_clock::now()) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(at.time_since_epoch()).count();
}

}  // namespace teletact::service
