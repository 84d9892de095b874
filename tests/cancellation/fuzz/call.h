// One call that sends its script and ends as planned: at an event of its own, or at a time.
#pragma once

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>

#include "tests/cancellation/fuzz/case.h"
#include "tests/cancellation/fuzz/later.h"
#include "tests/cancellation/fuzz/messages.h"

namespace teletact::test {

// A call neither ended by itself nor by what was done to it.
struct CallHangs : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct Plan {
  Case tried;
  Script script;
  std::string client;  // its name in the metadata; empty: none
  // The planned end comes after so many messages written or read, or after a time.
  std::optional<std::size_t> after_events;
  std::chrono::microseconds after{0};
};

Plan plan_for(const Case&, const Targets&, Random&);

class Call final : public grpc::ClientBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>,
                   public std::enable_shared_from_this<Call> {
 public:
  using Done = std::function<void(const Call&, const grpc::Status&)>;
  // `done` is called once, from gRPC's threads.
  Call(Plan plan, Done done) : plan_(std::move(plan)), done_(std::move(done)) {}
  // Lives until it is done.
  void start(const std::shared_ptr<grpc::Channel>& channel, Later& later);
  void cancel() { context_.TryCancel(); }
  const Case& tried() const { return plan_.tried; }
  // For people: how far it came.
  std::string progress() const;

 private:
  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnDone(const grpc::Status& status) override;

  bool reads() const { return plan_.tried.end != End::kNoRead; }
  // With mutex_ held:
  void write_more();
  void count_event();
  void bring_to_end();
  void let_go();
  void close_side();

  const Plan plan_;
  const Done done_;
  grpc::ClientContext context_;
  std::shared_ptr<Call> self_;  // until OnDone

  mutable std::mutex mutex_;
  grpc::ByteBuffer written_, read_;
  std::size_t next_ = 0, events_ = 0, answers_ = 0, answers_at_write_ = 0;
  std::uint64_t newest_ = 0;
  bool writing_ = false, closing_ = false, closed_ = false, held_ = false;
};

}  // namespace teletact::test
