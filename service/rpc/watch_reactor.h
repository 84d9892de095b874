// One watcher of a scene's finger. It is written to when it is looked at (Calls::kTick, so at most 100 times
// a second): no thread waits for it.
#pragma once

#include <atomic>
#include <memory>
#include <optional>

#include "service/rpc/core.h"
#include "service/rpc/served_call.h"
#include "service/touch_plane/finger_watch.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

class WatchReactor final : public ServedStream<v1::WatchFingerRequest, v1::FingerState> {
 public:
  WatchReactor(Core&, grpc::CallbackServerContext*);
  static WatchReactor* serve(Core&, grpc::CallbackServerContext*);

 private:
  std::optional<Wanted> wanted(const v1::WatchFingerRequest&) const override;
  void take(const v1::WatchFingerRequest&) override;
  void tick(Clock::time_point now) override;
  void check() const override;
  void closed() override;

  Core& core_;
  const Clock::time_point begun_ = Clock::now();
  std::unique_ptr<FingerWatch> watch_;
  std::atomic<bool> opened_{false};  // watch_ is there
  v1::FingerState state_;            // not touched while a write is under way
};

}  // namespace teletact::service
