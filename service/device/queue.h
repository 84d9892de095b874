// State of a Queue. Private to service/device.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "service/device/opencl.h"

namespace teletact::service {

struct Queue::State {
  explicit State(std::shared_ptr<Context>);
  ~State();  // what is on its way is still needed
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  std::shared_ptr<Context> context;
  std::shared_ptr<LaunchLog> log;
  std::shared_ptr<Pace> pace = std::make_shared<Pace>();
  std::shared_ptr<DeviceWork> work = std::make_shared<DeviceWork>();
  cl::CommandQueue queue;
  MemoryAccount account;
  std::vector<std::shared_ptr<const void>> sent;  // what may still be on its way to the device
  std::size_t sent_bytes = 0;
  void arrived();  // all of it, as after a blocking command; counts the wait and looks up
  // On a thread that looks up no more is moved at once than takes some milliseconds.
  void in_pieces(std::size_t bytes, const std::function<void(std::size_t first, std::size_t count)>& move);
};

}  // namespace teletact::service
