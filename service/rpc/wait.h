// Waiting in a handler for work on the imaging worker.
#pragma once

#include <grpcpp/server_context.h>

#include <atomic>
#include <chrono>
#include <future>
#include <memory>

#include "service/scene/errors.h"

namespace teletact::service {

// Set when nobody waits for the work any more; the work looks at it between its steps.
using Abandoned = std::shared_ptr<std::atomic<bool>>;

inline Abandoned not_abandoned() {
  return std::make_shared<std::atomic<bool>>(false);
}

// The future's value. When the call is cancelled or past its deadline, abandons the work and throws
// Error(kCancelled) at once.
template <class T>
T wait_for(std::future<T>& future, const grpc::ServerContext& context, const Abandoned& abandoned) {
  constexpr std::chrono::milliseconds kLook{20};
  while (future.wait_for(kLook) != std::future_status::ready) {
    if (!context.IsCancelled()) continue;
    *abandoned = true;
    throw Error(ErrorKind::kCancelled, "the call was cancelled or is past its deadline");
  }
  try {
    return future.get();
  } catch (const std::future_error&) {  // dropped unstarted
    throw Error(ErrorKind::kUnavailable, "the service is shutting down; connect again later");
  }
}

}  // namespace teletact::service
