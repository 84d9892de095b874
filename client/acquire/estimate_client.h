// One Elastography.Estimate call: uploads an RF pair in chunks and collects what comes back. Repeats the call
// while the service is UNAVAILABLE (restarting, draining): nothing is kept of a call that failed.
#pragma once

#include <grpcpp/channel.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

#include "client/acquire/frame_source.h"
#include "teletact/v1/elastography.grpc.pb.h"
#include "teletact/v1/info.pb.h"

namespace teletact::client {

// A call that the service refused, or that never got through.
struct ServiceError : std::runtime_error {
  ServiceError(grpc::StatusCode status_code, const std::string& message)
      : std::runtime_error(message), code(status_code) {}
  grpc::StatusCode code;
};

// Turns a failed status into a ServiceError that names the call and the code.
[[noreturn]] void throw_status(const char* call, const grpc::Status& status);

// What serves at the other end. Throws as throw_status() does.
teletact::v1::GetInfoResponse get_info(const std::shared_ptr<grpc::Channel>& channel);

struct EstimateOutcome {
  teletact::v1::EstimateSummary summary;
  std::vector<teletact::v1::Map> maps;
  std::int64_t last_byte_ns = 0;  // CLOCK_MONOTONIC: the last RF byte was handed to the transport
  std::int64_t published_ns = 0;  // the summary arrived
  unsigned attempts = 0;
};

struct EstimateCallbacks {  // all optional; called from the thread that called estimate()
  std::function<void(const teletact::v1::EstimateRequest&)> request;
  std::function<void(const teletact::v1::EstimateResponse&)> response;
  std::function<void(const std::string&)> waiting;  // once, in a line: the service is UNAVAILABLE
};

class EstimateClient {
 public:
  // `retry_for_s`: how long an UNAVAILABLE service is tried again.
  EstimateClient(const std::shared_ptr<grpc::Channel>& channel, double retry_for_s = 10);

  // Throws ServiceError, also (CANCELLED) when `stop` becomes true between attempts.
  EstimateOutcome estimate(const teletact::v1::Acquisition& acquisition, const std::string& pre,
                           const std::string& post, const EstimateCallbacks& callbacks,
                           const std::atomic<bool>& stop);
  // Ends the attempt that is being made, if any, with CANCELLED. From any thread.
  void cancel();

 private:
  grpc::Status attempt(const teletact::v1::Acquisition& acquisition, const std::string& pre,
                       const std::string& post, const EstimateCallbacks& callbacks, EstimateOutcome& outcome);

  std::unique_ptr<teletact::v1::Elastography::Stub> stub_;
  double retry_for_s_;
  std::mutex mutex_;
  std::shared_ptr<grpc::ClientContext> going_on_;  // the latest
};

}  // namespace teletact::client
