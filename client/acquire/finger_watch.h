// Follows Palpation.WatchFinger on a thread of its own and keeps the newest state: latest value wins.
#pragma once

#include <grpcpp/channel.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "client/acquire/window_planner.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::client {

class FingerWatch {
 public:
  FingerWatch(const std::shared_ptr<grpc::Channel>& channel, std::string scene_id);
  ~FingerWatch();
  FingerWatch(const FingerWatch&) = delete;
  FingerWatch& operator=(const FingerWatch&) = delete;

  // The newest state, its position advanced by its velocity over the time since it arrived (at most 0.1 s, so
  // that a silent link does not run away with the arm).
  FingerMotion motion(std::int64_t now_ns) const;

  bool seen() const;  // a finger has been present at some time
  // Since when the finger has been away (CLOCK_MONOTONIC ns); nothing while it is present or was never there.
  std::optional<std::int64_t> gone_since_ns() const;
  // Why the watch ended for good (scene deleted, call refused); empty while it runs or reconnects.
  std::string failure() const;

 private:
  void follow();
  bool read_stream();  // false: ended for good
  void store(const teletact::v1::FingerState& state);

  std::unique_ptr<teletact::v1::Palpation::Stub> stub_;
  std::string scene_id_;
  mutable std::mutex mutex_;
  FingerMotion newest_;
  std::int64_t arrived_ns_ = 0;
  bool seen_ = false, stopping_ = false;
  std::optional<std::int64_t> gone_since_ns_;
  std::string failure_;
  std::shared_ptr<grpc::ClientContext> context_;  // of the open stream, to cancel it
  std::thread thread_;
};

}  // namespace teletact::client
