// What all calls of the callback interface share: a place among those that are served, one who finishes it,
// and a stated end for a peer that withholds something.
//
// A call owns itself until gRPC is done with it (OnDone); whoever else looks at it shares it meanwhile, so
// nothing is deleted under anybody's feet and no lock is held while gRPC is called.
#pragma once

#include <fmt/format.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "service/base/current_trace.h"
#include "service/base/paced_log.h"
#include "service/rpc/call_life.h"
#include "service/rpc/call_of_connection.h"
#include "service/rpc/caller.h"
#include "service/rpc/calls.h"
#include "service/rpc/connections.h"
#include "service/rpc/core.h"
#include "service/rpc/status.h"
#include "service/scene/errors.h"

namespace teletact::service {

// `Reactor`: grpc::ServerBidiReactor<...> or grpc::ServerUnaryReactor.
template <class Reactor>
class ServedCall : public Reactor, public Served {
 public:
  using Clock = CallLife::Clock;
  // A call that has ended is cut when its end was not taken for so long: an answer that still waits to be
  // written, or the status.
  static constexpr std::chrono::seconds kEndTaken{3};
  // Where this machine got round to a connection late, what its peer has sent may be on its way for so long.
  static constexpr std::chrono::seconds kOnItsWay{2};

  void look(Clock::time_point now) final {
    if (const auto ended_at = life_.ended_at()) {
      if (now - *ended_at > patience()) cut();
    } else {
      during([&] {
        authorised([&] { caller_.look(now); });
        unless_late(now, [&] { tick(now); });
      });
    }
  }

 protected:
  // `method`: what the log calls one that took too long; null: it lasts as long as its peer wants.
  ServedCall(Core& core, grpc::CallbackServerContext* context, const char* method)
      : calls_(core.calls),
        context_(context),
        connection_(core.connections, *context, !kUnary),
        caller_(core.access),
        slow_calls_(core.slow_calls),
        method_(method),
        trace_(trace_of(traceparent_in(*context))) {}

  // The reactor for gRPC. One that is refused its place is told so and runs no further. `client` as
  // enter()'s.
  template <class Call>
  static Call* serve(std::shared_ptr<Call> call, CallKind kind, const std::string& client = "") {
    ServedCall& served = *call;
    served.self_ = call;
    served.kind_ = kind;
    served.during([&] {
      require_short_headers(*served.context_);
      served.authorised([&] { served.caller_.begin(*served.context_); });
      served.ticket_ = served.calls_.enter(kind, call, client);
      served.begun();
    });
    return call.get();  // not done before gRPC has it, whatever happened above
  }

  virtual void begun() {}                  // it has its place
  virtual void tick(Clock::time_point) {}  // as Served::look, while it has not ended; what it throws ends it
  virtual void ended() {}                  // at end(), by whom ever; may be called more than once
  virtual void closed() {}                 // gRPC is done
  virtual Clock::duration patience() const { return kEndTaken; }
  virtual std::vector<StageTime> stages() const { return {}; }  // of one that took too long

  // Runs `work` unless the call has ended; it is not done before `work` is. What it throws ends the call.
  template <class Work>
  void during(Work&& work) {
    if (!life_.begin()) return;
    const InTrace here(trace_);
    const grpc::Status worked = guarded([&] {
      work();
      return grpc::Status::OK;
    });
    if (!worked.ok()) end(worked);
    release();
  }
  // What the peer owes by a time is not asked for while the service has not taken what came.
  template <class Work>
  void unless_late(Clock::time_point now, Work&& work) {
    try {
      work();
    } catch (const Error& error) {
      if (error.kind != ErrorKind::kDeadline || now - connection_.late_at() > kOnItsWay) throw;
    }
  }
  // For what outlasts its caller (a write, a thread): hold() ... release().
  [[nodiscard]] bool hold() { return life_.begin(); }
  void release() { finish_if(life_.over()); }
  // The first status counts.
  void end(grpc::Status status) {
    const bool due = life_.end(std::move(status));
    ended();
    finish_if(due);
  }
  // Every call says what it is about, once it is known, before it does any of it. Throws where its caller may
  // not.
  void require(const Wanted& wanted) {
    authorised([&] { caller_.require(wanted); });
    connection_.vouch();
  }
  const CallLife& life() const { return life_; }
  std::shared_ptr<ServedCall> self() const { return self_; }  // within begun(), tick() or during()
  std::uint64_t id() const { return ticket_->id(); }          // of a call that has its place
  const std::string& who() const { return caller_.name(); }

  Calls& calls_;
  grpc::CallbackServerContext* const context_;
  CallOfConnection connection_;
  Caller caller_;

 private:
  static constexpr bool kUnary = std::is_same_v<Reactor, grpc::ServerUnaryReactor>;
  void OnCancel() final { end(grpc::Status::CANCELLED); }
  void OnDone() final {
    const InTrace here(trace_);
    tell_if_slow();
    closed();
    {
      const std::lock_guard lock(cutting_);
      done_ = true;
    }
    const grpc::StatusCode code = life_.status().error_code();
    calls_.ended(kind_, code);
    // One that is reset may have ended before it was told so.
    if (context_->IsCancelled() || code == grpc::StatusCode::CANCELLED ||
        code == grpc::StatusCode::UNAUTHENTICATED || code == grpc::StatusCode::PERMISSION_DENIED)
      connection_.waste();
    ticket_.reset();
    const auto last = std::move(self_);
  }
  void tell_if_slow() {
    const auto now = Clock::now();
    if (!method_ || !slow_calls_.too_long(now - since_)) return;
    slow_calls_.tell(now, [&] {
      std::vector<StageTime> all = stages();
      if (const auto ended_at = life_.ended_at()) all.push_back({"taken", now - *ended_at});
      return fmt::format("method={} code={} {}", method_, static_cast<int>(life_.status().error_code()),
                         key_values(now - since_, all));
    });
  }
  // What it throws of access is counted and logged.
  template <class Ask>
  void authorised(Ask&& ask) {
    try {
      ask();
    } catch (const AccessRefused& refused) {
      calls_.refused_authority(kind_);
      caller_.log(
          fmt::format("kind={} peer={}", kKindNames[static_cast<std::size_t>(kind_)], context_->peer()),
          refused);
      throw;
    }
  }
  void finish_if(bool due) {
    if (!due) return;
    const grpc::Status status = life_.status();
    // The status that ends a unary call well carries its answer, which the place is for.
    if (ticket_ && !(status.ok() && kUnary)) ticket_->give_place_back();
    this->Finish(status);  // here alone; OnDone may follow at once
  }
  void cut() {
    const std::lock_guard lock(cutting_);
    if (!done_) context_->TryCancel();
  }

  SlowLog& slow_calls_;
  const char* const method_;
  const TraceId trace_;
  const Clock::time_point since_ = Clock::now();
  CallLife life_;
  CallKind kind_{};
  std::unique_ptr<Calls::Ticket> ticket_;
  std::shared_ptr<ServedCall> self_;
  std::mutex cutting_;
  bool done_ = false;  // context_ is no more
};

// A stream that reads one message after the other, no faster than stated, and has at most one write under
// way.
template <class Request, class Response>
class ServedStream : public ServedCall<grpc::ServerBidiReactor<Request, Response>> {
  using Base = ServedCall<grpc::ServerBidiReactor<Request, Response>>;

 protected:
  using Clock = CallLife::Clock;
  ServedStream(Core& core, grpc::CallbackServerContext* context, Allowance messages)
      : Base(core, context, nullptr), messages_(messages), patience_(seconds(core.limits.acknowledge_s)) {}

  // What the stream is about, by the message that opens it; none of another. Asked until it is known.
  virtual std::optional<Wanted> wanted(const Request&) const = 0;
  virtual void take(const Request&) = 0;  // what it throws ends the call
  virtual void written() {}               // the write is no longer under way
  // Throws what the service has against its going on: it drains, the scene is gone. Thread-safe.
  virtual void check() const {}

  void begun() override { read(); }
  void tick(Clock::time_point now) override {
    check();
    if (waiting_ && messages_.take(now)) read();
    require_taken(now);
  }
  // What wanted() said of the message that opened it.
  const Wanted& required() const { return *required_; }
  bool writing() const { return writing_.load(); }
  // The caller leaves `response` alone until writing() is false. False: the call has ended, nothing is
  // written.
  bool write(const Response& response) {
    if (!this->hold()) return false;
    written_at_ = Clock::now();
    writing_ = true;
    this->StartWrite(&response);
    return true;
  }

 private:
  // A peer that reads nothing holds its place by what it sends alone.
  void require_taken(Clock::time_point now) const {
    if (writing_ && now - written_at_.load() > patience_)
      throw Error(ErrorKind::kDeadline,
                  "the stream's answers: none was taken in time; read what is sent, or open fewer streams");
  }
  void read() {
    waiting_ = false;
    this->StartRead(&request_);
  }
  void OnReadDone(bool ok) final {
    if (!ok) {  // the peer has closed its side, or the call is over
      this->during([this] { check(); });
      return this->end(grpc::Status::OK);
    }
    this->during([this] {
      if (!required_ && (required_ = wanted(request_))) this->require(*required_);
      this->unless_late(Clock::now(), [this] { take(request_); });
      if (messages_.take(Clock::now()))
        read();
      else
        waiting_ = true;  // the transport holds the peer back until a tick reads on
    });
  }
  void OnWriteDone(bool ok) final {
    writing_ = false;
    if (!ok) this->end(grpc::Status::CANCELLED);
    written();
    this->release();
  }
  Request request_;
  std::optional<Wanted> required_;  // of whoever reads
  Allowance messages_;              // of whoever may read on: OnReadDone, or the tick while waiting_
  const Clock::duration patience_;
  std::atomic<Clock::time_point> written_at_{};
  std::atomic<bool> writing_{false}, waiting_{false};
};

}  // namespace teletact::service
