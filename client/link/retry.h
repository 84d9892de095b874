// Whether a call that failed is worth trying again, and after how long.
#pragma once

#include <grpcpp/support/status.h>

#include <algorithm>
#include <utility>

namespace teletact::client {

// The same call would be refused again: it asks for what is not there, not allowed or not known.
inline bool refused_for_good(const grpc::Status& status) {
  using enum grpc::StatusCode;
  const auto code = status.error_code();
  return code == INVALID_ARGUMENT || code == NOT_FOUND || code == UNIMPLEMENTED ||
         code == PERMISSION_DENIED || code == UNAUTHENTICATED;
}

// Waits that double, from the first to the longest.
class Backoff {
 public:
  Backoff(double first_s, double longest_s) : first_s_(first_s), longest_s_(longest_s), next_s_(first_s) {}
  void restart() { next_s_ = first_s_; }
  double next_s() { return std::exchange(next_s_, std::min(2 * next_s_, longest_s_)); }

 private:
  double first_s_, longest_s_, next_s_;
};

}  // namespace teletact::client
