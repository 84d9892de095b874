// Follows Palpation.WatchFinger on a thread of its own and keeps the newest state: latest value wins. The
// service says at least once a second where the finger is; a stream that says nothing for dead_s is dead (a
// half-open connection says nothing for ever) and is opened again on a new connection.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "client/acquire/window_planner.h"
#include "client/link/credentials.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::client {

class FingerWatch {
 public:
  // Along the axis that windows lie on: 0 for x, 2 for z.
  FingerWatch(std::string address, Credentials credentials, std::string scene_id, int axis = 0,
              double dead_s = 2);
  ~FingerWatch();
  FingerWatch(const FingerWatch&) = delete;
  FingerWatch& operator=(const FingerWatch&) = delete;

  // The newest state, its position advanced by its velocity over the time since it was news (at most 0.1 s,
  // so that a silent link does not run away with the arm; a state that is repeated to keep the watch alive is
  // none).
  FingerMotion motion(std::int64_t now_ns) const;

  // The slice that the newest state asks for, as it came: it may make no sense.
  std::optional<teletact::v1::SliceWish> wish() const;
  // Since when the finger has been away (CLOCK_MONOTONIC ns); nothing while it is present or was never there.
  std::optional<std::int64_t> gone_since_ns() const;
  // Why the watch ended for good (no such scene, call refused); empty while it runs or reconnects.
  std::string failure() const;

 private:
  void follow();
  bool read_stream();  // false: ended for good
  void end_dead_streams();
  void store(const teletact::v1::FingerState& state);

  std::string address_, scene_id_;
  Credentials credentials_;
  int axis_;
  double dead_s_;
  mutable std::mutex mutex_;  // everything below
  std::condition_variable stopped_;
  FingerMotion newest_;
  std::optional<teletact::v1::SliceWish> wish_;
  std::int64_t arrived_ns_ = 0;              // of the newest state, or when its stream was opened
  std::int64_t stamp_ns_ = 0, news_ns_ = 0;  // of the newest pose: the service's clock; when it came first
  bool seen_ = false, stopping_ = false;
  std::optional<std::int64_t> gone_since_ns_;
  std::string failure_;
  std::shared_ptr<grpc::ClientContext> context_;  // of the open stream, to cancel it
  std::thread thread_, guard_;
};

}  // namespace teletact::client
