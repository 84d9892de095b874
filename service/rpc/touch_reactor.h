// One touch stream. gRPC's threads bring its poses; a thread of the stream's own answers and writes.
#pragma once

#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "service/rpc/core.h"
#include "service/rpc/served_call.h"
#include "service/touch_plane/touch_stream.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

class TouchReactor final : public ServedStream<v1::TouchRequest, v1::TouchResponse> {
 public:
  TouchReactor(Core&, grpc::CallbackServerContext*);
  static TouchReactor* serve(Core&, grpc::CallbackServerContext*);

 private:
  std::optional<Wanted> wanted(const v1::TouchRequest&) const override;
  void take(const v1::TouchRequest&) override;
  void tick(Clock::time_point now) override;
  void check() const override;
  void written() override { wake(); }
  void ended() override { wake(); }
  void closed() override;

  void wake() {
    if (opened_) stream_->wake();
  }
  void open(const v1::TouchOpen&);
  void answer_and_write();  // the stream's thread
  void write_opened();
  void write_answer(const TouchStream::Arrived&);
  void write_law(const LawPiece&);

  Core& core_;
  const Clock::time_point begun_ = Clock::now();
  std::string name_;  // for logs: the client's session id
  std::unique_ptr<TouchStream> stream_;
  std::atomic<bool> opened_{false};  // stream_ is there

  // The stream's thread.
  v1::TouchResponse response_;  // not touched while a write is under way
  std::thread thread_;
};

}  // namespace teletact::service
