// State of a Queue. Private to service/device.
#pragma once

#include "service/device/opencl.h"

namespace teletact::service {

struct Queue::State {
  explicit State(std::shared_ptr<Context>);
  std::shared_ptr<Context> context;
  std::shared_ptr<LaunchLog> log;
  cl::CommandQueue queue;
};

}  // namespace teletact::service
