// One touch stream as a load.
#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/support/client_callback.h>

#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>

#include "bench/load/tally.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::bench {

struct FingerPlan {
  v1::TouchOpen open;  // but its credit and period
  // Where the finger is, s since `begin`: position and velocity of a pose.
  std::function<void(double time_s, v1::ContactPose& to)> pose;
  unsigned in_flight = 8;                  // poses that may be without an answer
  bool closed_loop = false;                // the next pose is meant when the answer is there
  bool greedy = false;                     // sends at once, whatever period the service keeps
  double counted_from_s = 0, until_s = 0;  // until: no pose of a closed loop is meant later
};

// Everything it is told, and says, is on one clock: seconds since `begin`.
class LoadSession final : public grpc::ClientBidiReactor<v1::TouchRequest, v1::TouchResponse> {
 public:
  using Clock = std::chrono::steady_clock;
  LoadSession(std::shared_ptr<grpc::Channel>, FingerPlan, Clock::time_point begin);
  // Cuts the stream where it still runs, and waits for its end.
  ~LoadSession() override;
  LoadSession(const LoadSession&) = delete;
  LoadSession& operator=(const LoadSession&) = delete;

  // A pose is meant to be sent. Where it cannot be, a newer one takes its place, and this one is held back.
  void due(double due_s);
  // kServed: the last pose has been meant, and had its time to be answered. kLeft: poses without an answer
  // are not asked any more, nor counted; kDropped: the same, and the call is dropped as it stands.
  enum class End { kServed, kLeft, kDropped };
  void end(End);
  bool ended();
  // Waits until the stream has ended, at `limit` cuts it. After end().
  Tally finish(Clock::time_point limit);

 private:
  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnDone(const grpc::Status&) override;

  double now_s() const { return std::chrono::duration<double>(Clock::now() - begin_).count(); }
  void intend(double due_s);
  void intend_next();  // of a closed loop, where the last is answered
  void send_newest();  // where it may be sent
  // gRPC keeps a call until nobody may start anything from outside of reactions. Not under the mutex.
  void let_go();

  FingerPlan plan_;
  Clock::time_point begin_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::Palpation::Stub> stub_;
  grpc::ClientContext context_;
  v1::TouchRequest request_;
  v1::TouchResponse response_;

  std::mutex mutex_;
  std::condition_variable changed_;
  Tally tally_;
  Unanswered unanswered_;
  struct Pose {
    std::uint64_t sequence;
    double due_s;
  };
  std::optional<Pose> newest_;      // meant, not sent
  std::deque<std::uint64_t> sent_;  // without an answer
  double called_s_;
  double sent_s_ = -1e9, period_s_ = 0;  // the last pose; between poses, as the service keeps it
  std::uint64_t acknowledged_ = 0, laws_acknowledged_ = 0;
  bool opened_ = false, writing_ = true, ending_ = false, cancelled_ = false, cut_ = false, held_ = true,
       done_ = false;
};

}  // namespace teletact::bench
