// One watcher of a scene's finger. It is written to when it is looked at (Calls::kTick, so at most 100 times
// a second), the newest state, and only once it has acknowledged the last: no thread waits for it, and a
// watcher that stops reading is never more than one state behind.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>

#include "service/rpc/core.h"
#include "service/rpc/served_call.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

class WatchReactor final : public ServedStream<v1::WatchFingerRequest, v1::FingerState> {
 public:
  static constexpr std::chrono::milliseconds kHeartbeat{500};  // between states of a finger at rest

  WatchReactor(Core&, grpc::CallbackServerContext*);
  static WatchReactor* serve(Core&, grpc::CallbackServerContext*);

 private:
  void take(const v1::WatchFingerRequest&) override;
  void tick(Clock::time_point now) override;
  void check() const override;
  void closed() override;
  // Whether state_ is a new one to write.
  bool compose(Clock::time_point now);

  Core& core_;
  mutable std::mutex mutex_;  // scene_, counts
  std::shared_ptr<Scene> scene_;
  std::uint64_t written_ = 0, acknowledged_ = 0;

  // Of the ticks.
  Clock::time_point since_ = Clock::now();  // the last state was written, or the call began
  std::uint64_t generation_ = 0;            // of the finger that was written
  v1::FingerState state_;                   // not touched while a write is under way
};

}  // namespace teletact::service
