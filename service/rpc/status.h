// Exceptions of the domain become canonical codes here and nowhere else.
#pragma once

#include <grpcpp/support/status.h>

#include <exception>

namespace teletact::service {

grpc::Status status_of(std::exception_ptr) noexcept;

// "RESOURCE_EXHAUSTED"
const char* name_of(grpc::StatusCode);

// Runs `work`, which returns a grpc::Status or throws.
template <class Work>
grpc::Status guarded(Work&& work) noexcept {
  try {
    return work();
  } catch (...) {
    return status_of(std::current_exception());
  }
}

}  // namespace teletact::service
