#include "tests/cancellation/fuzz/call.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace teletact::test {

namespace {

constexpr std::chrono::milliseconds kEventNeverComes{50}, kFar{300};

grpc::ByteBuffer buffer_of(const std::string& bytes) {
  const grpc::Slice slice(bytes);
  return {&slice, 1};
}

std::string string_of(const grpc::ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  buffer.Dump(&slices);
  std::string bytes;
  for (const grpc::Slice& slice : slices)
    bytes.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
  return bytes;
}

}  // namespace

Plan plan_for(const Case& tried, const Targets& targets, Random& random) {
  Plan plan{tried, script_for(tried, targets, random), "", {}, {}};
  if (random.chance(0.5)) plan.client = "fuzz-" + std::to_string(random.below(4));
  if (random.chance(0.05)) plan.client = std::string(random.chance(0.5) ? 65 : 2000, 'n');
  // At once, while the call is young, when it has come far; or when it has ended by itself, mostly.
  const double longest_us = random.one_of(std::array{0.0, 300.0, 3000.0, 30'000.0});
  plan.after = std::chrono::microseconds(static_cast<std::int64_t>(random.within(0, longest_us)));
  if (random.chance(tried.state == ServiceState::kDeleted ? 0.3 : 0.05)) plan.after = kFar;
  if (tried.end == End::kHalfClose && tried.method == Method::kEstimate && random.chance(0.5)) {
    plan.after = kFar;  // by then the upload is whole
    return plan;
  }
  const bool by_event = tried.end == End::kCancel || tried.end == End::kHalfClose;
  if (by_event && random.chance(0.5)) plan.after_events = random.below(6);
  return plan;
}

void Call::start(const std::shared_ptr<grpc::Channel>& channel, Later& later) {
  self_ = shared_from_this();
  const auto self = self_;  // it may be done before this function is
  const End end = plan_.tried.end;
  if (!plan_.client.empty()) context_.AddMetadata("teletact-client", plan_.client);
  held_ = end == End::kHalfClose;  // writing from outside gRPC's reactions needs a hold
  if (end == End::kDeadline) context_.set_deadline(std::chrono::system_clock::now() + plan_.after);
  grpc::GenericStub stub(channel);
  stub.PrepareBidiStreamingCall(&context_, path_of(plan_.tried.method), {}, this);
  {
    const std::lock_guard lock(mutex_);
    if (held_) AddHold();
    if (reads()) StartRead(&read_);
    write_more();
    if (plan_.after_events == std::size_t{0}) bring_to_end();
  }
  StartCall();
  if (end == End::kDeadline || end == End::kReset) return;  // others bring these to their end
  if (end == End::kHalfClose && plan_.tried.method == Method::kHealthWatch)
    later.after(kEventNeverComes, [self] { self->cancel(); });  // it has no other end
  later.after(plan_.after_events ? kEventNeverComes : plan_.after, [self] {
    const std::lock_guard lock(self->mutex_);
    self->bring_to_end();
  });
}

void Call::bring_to_end() {
  if (plan_.tried.end != End::kHalfClose) return context_.TryCancel();
  closing_ = true;
  if (held_) write_more();
  let_go();
}

void Call::let_go() {
  if (std::exchange(held_, false)) RemoveHold();
}

void Call::close_side() {
  if (closed_) return;
  closed_ = true;
  StartWritesDone();
}

void Call::write_more() {
  if (writing_ || closed_) return;
  const auto& messages = plan_.script.messages;
  const bool repeats = next_ == messages.size() && plan_.script.repeats_last;
  // The single message of such a call is part of the call; the others may be cut off anywhere.
  const bool goes_on = !closing_ || sends_one(plan_.tried.method);
  if (goes_on && (next_ < messages.size() || (repeats && answers_ > answers_at_write_))) {
    const Message& message = messages[repeats ? next_ - 1 : next_];
    if (answers_ >= message.after_answers) {
      next_ += repeats ? 0 : 1;
      answers_at_write_ = answers_;
      writing_ = true;
      written_ = buffer_of(message.bytes(newest_));
      return StartWrite(&written_);
    }
  }
  const bool all_sent = next_ == messages.size() && !repeats;
  const bool said_all = plan_.tried.method == Method::kEstimate || sends_one(plan_.tried.method);
  if (closing_ || (all_sent && said_all && plan_.tried.content != Content::kBroken)) close_side();
}

void Call::count_event() {
  ++events_;
  if (plan_.after_events == events_) bring_to_end();
}

void Call::OnReadDone(bool ok) {
  const std::lock_guard lock(mutex_);
  if (!ok) return let_go();  // nothing more comes
  ++answers_;
  newest_ = std::max(newest_, number_in(plan_.tried.method, string_of(read_)));
  StartRead(&read_);
  count_event();
  write_more();
}

void Call::OnWriteDone(bool ok) {
  const std::lock_guard lock(mutex_);
  writing_ = false;
  if (!ok) return;
  count_event();
  write_more();
}

void Call::OnDone(const grpc::Status& status) {
  const auto self = std::move(self_);
  done_(*this, status);
}

std::string Call::progress() const {
  const std::lock_guard lock(mutex_);
  return name_of(plan_.tried) + ": " + std::to_string(next_) + " of " +
         std::to_string(plan_.script.messages.size()) + " messages sent, " + std::to_string(answers_) +
         " answers, side " + (closed_ ? "closed" : "open") + (writing_ ? ", a write is going on" : "");
}

}  // namespace teletact::test
