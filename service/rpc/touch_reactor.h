// One touch stream. gRPC's threads read poses into a mailbox of one; a thread of the stream's own takes the
// newest, solves and writes. It writes only while fewer than `credit` answers are unacknowledged, so a client
// that does not read is never more than `credit` answers behind and the service buffers nothing for it.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "service/rpc/core.h"
#include "service/rpc/served_call.h"
#include "service/scene/mailbox.h"
#include "service/scene/touch_session.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

class TouchReactor final : public ServedStream<v1::TouchRequest, v1::TouchResponse> {
 public:
  static constexpr double kDefaultPeriodS = 0.002;
  static constexpr std::size_t kMostSessionIdBytes = 64;

  TouchReactor(Core&, grpc::CallbackServerContext*);
  static TouchReactor* serve(Core&, grpc::CallbackServerContext*);

 private:
  struct Pose {
    v1::ContactPose pose;
    Vector3 position_m;  // of it
    Clock::time_point arrived;
  };

  void take(const v1::TouchRequest&) override;
  void tick(Clock::time_point now) override;
  void check() const override;
  void written() override { inbox_.wake(); }
  void ended() override { inbox_.wake(); }
  void closed() override;

  void open(const v1::TouchOpen&);
  void take_pose(const v1::ContactPose&);
  FingerBoard& board() { return session_->scene()->finger(); }
  void solve_and_write();  // the stream's thread
  template <class Message>
  void steering_to(Message&);
  void write_opened();
  void write_answer(const Pose&);

  Core& core_;
  std::string name_;                // for logs: the client's session id
  FingerBoard::Stream finger_ = 0;  // this stream's at the scene's board

  // gRPC's reading thread.
  std::uint64_t last_sequence_ = 0;
  std::atomic<Clock::time_point> heard_{Clock::now()};  // since when the next open or pose is waited for
  std::atomic<Clock::time_point> owed_{};               // since when an answer waits to be acknowledged

  // The stream's thread.
  std::unique_ptr<TouchSession> session_;
  std::atomic<bool> opened_{false};  // session_ is there
  v1::TouchResponse response_;       // not touched while a write is under way
  std::uint32_t credit_ = 1;
  Clock::duration period_{};
  std::thread thread_;

  Mailbox<Pose> inbox_;
  std::atomic<std::uint64_t> written_{0}, acknowledged_{0};
  std::uint64_t poses_ = 0, poses_lost_ = 0;
};

}  // namespace teletact::service
