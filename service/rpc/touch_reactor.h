// One touch stream. gRPC's threads read poses into a mailbox of one; a thread of the stream's own takes the
// newest, solves and writes. It writes only while fewer than `credit` answers are unacknowledged, so a client
// that does not read is never more than `credit` answers behind and the service buffers nothing for it.
#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "service/rpc/core.h"
#include "service/scene/mailbox.h"
#include "service/scene/touch_session.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

class TouchReactor final : public grpc::ServerBidiReactor<v1::TouchRequest, v1::TouchResponse> {
 public:
  static constexpr double kDefaultPeriodS = 0.002;

  TouchReactor(Core&, grpc::CallbackServerContext*);

 private:
  using Clock = std::chrono::steady_clock;
  struct Pose {
    v1::ContactPose pose;
    Clock::time_point arrived;
  };

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

  void open(const v1::TouchOpen&);
  void take_pose(const v1::ContactPose&);
  void solve_and_write();  // the stream's thread
  void write_opened();
  void write_answer(const Pose&);
  void write();
  // Ends the stream with `status`; the first call counts.
  void end(grpc::Status status);

  Core& core_;
  grpc::CallbackServerContext* const context_;
  std::unique_ptr<Calls::Ticket> ticket_;
  std::string name_;  // for logs: the client's session id

  // gRPC's reading thread.
  v1::TouchRequest request_;
  std::uint64_t last_sequence_ = 0;

  // The stream's thread.
  std::unique_ptr<TouchSession> session_;
  std::uint64_t deletion_callback_ = 0;
  v1::TouchResponse response_;  // not touched while a write is in flight
  std::uint32_t credit_ = 1;
  Clock::duration period_{};
  std::thread thread_;

  Mailbox<Pose> inbox_;
  std::atomic<std::uint64_t> written_{0}, acknowledged_{0};
  std::atomic<bool> writing_{false}, stop_{false};
  std::uint64_t poses_ = 0, poses_lost_ = 0;
  std::mutex ending_;
  std::optional<grpc::Status> status_;
};

}  // namespace teletact::service
