// One unary call, answered from whatever thread has the answer; none waits for the peer meanwhile. It keeps
// its place, and with it what the answer holds, until the peer has taken the answer or time is up.
#pragma once

#include <google/protobuf/message.h>

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "service/rpc/core.h"
#include "service/rpc/served_call.h"

namespace teletact::service {

class UnaryCall final : public ServedCall<grpc::ServerUnaryReactor> {
 public:
  // Whoever is to answer holds this. When the last holder lets go of a call that is not answered, it ends
  // with UNAVAILABLE: the work was dropped because the service stops.
  using Handle = std::shared_ptr<UnaryCall>;
  struct Kind {
    const char* method;
    CallKind kind;
    Wanted wanted;  // what its caller has to be allowed to
  };
  // Called once the call has its place; what it throws is the answer.
  using Begin = std::function<void(const Handle&)>;

  static UnaryCall* serve(Core& core, grpc::CallbackServerContext* context, Kind kind, Begin begin) {
    const CallKind place = kind.kind;
    return ServedCall::serve(std::make_shared<UnaryCall>(core, context, std::move(kind), std::move(begin)),
                             place);
  }
  UnaryCall(Core& core, grpc::CallbackServerContext* context, Kind kind, Begin begin)
      : ServedCall(core, context, kind.method),
        core_(core),
        wanted_(std::move(kind.wanted)),
        begin_(std::move(begin)) {}

  bool may(const Wanted& wanted) const { return caller_.may(wanted); }

  // `work` fills the response; what it throws is the answer. Not run when the call was given up: request and
  // response may be gone then.
  template <class Work>
  void answer(const google::protobuf::Message& response, Work&& work) {
    during([&] {
      const auto begun = Clock::now();
      work();
      answered_ = StageTime{"answer", Clock::now() - begun};
      // A slow link is no reason to cut an answer that is being taken: 1 MiB/s is enough.
      const double more_s = static_cast<double>(response.ByteSizeLong()) / (1 << 20);
      patience_ = seconds(core_.limits.answer_taken_s + more_s);
      end(grpc::Status::OK);
    });
  }
  // `drop` takes back the job that was posted for it, where it has not begun: called when the call is given
  // up, so that nothing of it waits any more.
  void drop_by(std::function<void()> drop) {
    {
      const std::lock_guard lock(dropping_);
      drop_ = std::move(drop);
    }
    if (life().ended()) ended();  // before the job was known
  }
  // What it takes, until the peer has taken the answer. By whoever works for it.
  void hold(Charge memory) { held_ = std::move(memory); }
  void fail(std::exception_ptr error) { end(status_of(error)); }

 private:
  void begun() override {
    const Handle handle(this, [self = self()](UnaryCall* call) {
      call->end({grpc::StatusCode::UNAVAILABLE, "the service is shutting down; connect again later"});
    });
    const grpc::Status status = guarded([&] {
      require(wanted_);
      begin_(handle);
      return grpc::Status::OK;
    });
    if (!status.ok()) end(status);  // before the handle says that nobody answers
    begin_ = {};
  }
  void ended() override {
    if (life().status().ok()) return;
    std::function<void()> drop;
    {
      const std::lock_guard lock(dropping_);
      drop = std::exchange(drop_, {});
    }
    if (drop) drop();
  }
  Clock::duration patience() const override { return patience_.load(); }
  std::vector<StageTime> stages() const override {
    return answered_ ? std::vector{*answered_} : std::vector<StageTime>{};
  }

  Core& core_;
  const Wanted wanted_;
  Charge held_;
  Begin begin_;
  std::optional<StageTime> answered_;  // the response was filled
  std::atomic<Clock::duration> patience_{kEndTaken};
  std::mutex dropping_;
  std::function<void()> drop_;
};

}  // namespace teletact::service
