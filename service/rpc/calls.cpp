#include "service/rpc/calls.h"

#include <fmt/format.h>

#include <algorithm>

#include "service/scene/errors.h"

namespace teletact::service {

Calls::Ticket::Ticket(Calls* calls, CallKind kind, std::uint64_t id) : calls_(calls), kind_(kind), id_(id) {
  active();
}

Calls::Ticket::~Ticket() {
  const std::lock_guard lock(calls_->mutex_);
  calls_->tickets_.erase(id_);
  calls_->left_.notify_all();
}

void Calls::Ticket::active() {
  heard_ = Clock::now().time_since_epoch().count();
}

Calls::Calls(const Limits& limits) : limits_(limits), janitor_([this] { look_for_idle_calls(); }) {}

std::size_t Calls::most(CallKind kind) const {
  switch (kind) {
    case CallKind::kTouch:
      return limits_.most_touch_streams;
    case CallKind::kWatch:
      return limits_.most_watchers;
    case CallKind::kEstimate:
      return limits_.most_estimates;
  }
  return 0;
}

Calls::Clock::duration Calls::longest_silence(CallKind kind) const {
  const double most_s = kind == CallKind::kEstimate ? limits_.upload_idle_s : limits_.touch_idle_s;
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(most_s));
}

Calls::~Calls() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  stopping_.notify_all();
  janitor_.join();
}

void Calls::open() {
  state_ = State::kOpen;
}

void Calls::require_open() const {
  if (state_ == State::kStarting)
    throw Error(ErrorKind::kUnavailable, "the service is starting; wait until its health is SERVING");
  if (state_ == State::kDraining)
    throw Error(ErrorKind::kUnavailable, "the service is shutting down; connect again later");
}

std::unique_ptr<Calls::Ticket> Calls::enter(CallKind kind, std::function<void()> on_drain,
                                            std::function<void()> on_idle) {
  const std::lock_guard lock(mutex_);
  require_open();
  const auto same =
      std::count_if(tickets_.begin(), tickets_.end(), [&](auto& t) { return t.second->kind_ == kind; });
  if (static_cast<std::size_t>(same) >= most(kind))
    throw Error(ErrorKind::kExhausted,
                fmt::format("{} calls of this kind are open, no more are served; try again later", same));
  std::unique_ptr<Ticket> ticket(new Ticket(this, kind, next_id_++));
  ticket->on_drain_ = std::move(on_drain);
  ticket->on_idle_ = std::move(on_idle);
  tickets_[ticket->id()] = ticket.get();
  return ticket;
}

void Calls::drain() {
  const std::lock_guard lock(mutex_);
  if (state_.exchange(State::kDraining) == State::kDraining) return;
  for (const auto& [id, ticket] : tickets_)
    if (ticket->on_drain_) ticket->on_drain_();
}

std::size_t Calls::count() const {
  const std::lock_guard lock(mutex_);
  return tickets_.size();
}

void Calls::wait_until_none(Clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  left_.wait_until(lock, deadline, [this] { return tickets_.empty(); });
}

void Calls::look_for_idle_calls() {
  constexpr std::chrono::seconds kLook{1};
  std::unique_lock lock(mutex_);
  while (!stopping_.wait_for(lock, kLook, [this] { return stop_; })) {
    const auto now = Clock::now();
    for (const auto& [id, ticket] : tickets_) {
      const auto silent_since = (now - longest_silence(ticket->kind_)).time_since_epoch().count();
      if (ticket->on_idle_ && ticket->heard_ < silent_since && !ticket->idle_.exchange(true))
        ticket->on_idle_();
    }
  }
}

}  // namespace teletact::service
