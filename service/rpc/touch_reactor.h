// One touch stream. gRPC's threads bring its poses; the touch plane's workers answer and write.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "service/rpc/core.h"
#include "service/rpc/served_call.h"
#include "service/touch_plane/mailbox.h"
#include "service/touch_plane/touch_stream.h"
#include "service/touch_plane/touch_workers.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

class TouchReactor final : public ServedStream<v1::TouchRequest, v1::TouchResponse>, private TouchTurns {
 public:
  TouchReactor(Core&, grpc::CallbackServerContext*);
  static TouchReactor* serve(Core&, grpc::CallbackServerContext*);

 private:
  std::optional<Wanted> wanted(const v1::TouchRequest&) const override;
  void take(const v1::TouchRequest&) override;
  void tick(Clock::time_point now) override;
  void check() const override;
  void written() override;
  void ended() override;
  void closed() override;
  Done turn(Clock::duration period) override;
  void left() override { release(); }  // OnDone may follow at once

  void wake();
  void open(const v1::TouchOpen&);
  void bring(const v1::ContactPose&);
  void say(const TouchStream::Opened&);
  void say(const TouchStream::Answered&);
  void say(const LawPiece&);
  void note_if_slow(const TouchStream::Answered&);
  void tell_of_slow(Clock::time_point now);

  Core& core_;
  const Clock::time_point begun_ = Clock::now();
  std::string name_;  // for logs: the client's session id
  std::unique_ptr<TouchStream> stream_;
  std::atomic<bool> opened_{false};  // stream_ is there

  TouchWorkers::Id turns_ = 0;
  v1::TouchResponse response_;  // of whose turn it is; not touched while a write is under way

  // A slow answer, told by the thread that looks after calls: who answers does not wait for the log.
  struct Slow {
    Clock::duration queued, computed;
  };
  std::mutex slow_mutex_;
  Mailbox<Slow> slow_;
};

}  // namespace teletact::service
