#include "service/rpc/calls.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "service/scene/errors.h"

namespace teletact::service {

namespace {

// By CallKind.
constexpr std::array kCallNames{"touch streams", "watchers of fingers", "observers of scenes",
                                "estimates",     "short calls",         "whole scenes that are sent",
                                "short calls"};
constexpr std::array kMaxCalls{&Limits::max_touch_streams, &Limits::max_watchers,    &Limits::max_observers,
                               &Limits::max_estimates,     &Limits::max_unary_calls, &Limits::max_full_scenes,
                               &Limits::max_unary_calls};

}  // namespace

Calls::Ticket::~Ticket() {
  calls_->leave(id_);
}

void Calls::Ticket::give_place_back() {
  const std::lock_guard lock(calls_->mutex_);
  calls_->give_back(calls_->places_.at(id_));
}

void Calls::give_back(Place& place) {
  constexpr double kOfNew = 0.125;
  const auto begun = std::exchange(place.begun, std::nullopt);
  if (!begun) return;
  const double held_s = std::chrono::duration<double>(Clock::now() - *begun).count();
  double& mean_s = held_s_[static_cast<std::size_t>(place.kind)];
  mean_s = mean_s > 0 ? mean_s + kOfNew * (held_s - mean_s) : held_s;
}

void Calls::leave(std::uint64_t id) {
  const std::lock_guard lock(mutex_);
  const auto place = places_.find(id);
  give_back(place->second);
  places_.erase(place);
  left_.notify_all();
}

// When one of so many places is free: they are held as long as the last ones were.
std::string Calls::again(CallKind kind, std::size_t places) const {
  constexpr double kSoonest = 1, kLatest = 60;
  const double held_s = held_s_[static_cast<std::size_t>(kind)];
  if (!(held_s > 0)) return "none has ended since the start: try again in 10 s";
  const double free_s = held_s / static_cast<double>(places);
  const double again_s = std::clamp(std::ceil(free_s), kSoonest, kLatest);
  if (free_s < kSoonest)
    return fmt::format("one ends every second or sooner as of late: try again in {:.0f} s", again_s);
  return fmt::format("one ends every {:.0f} s as of late: try again in {:.0f} s", free_s, again_s);
}

Calls::Calls(const Limits& limits) : limits_(limits), looking_([this] { look_after_calls(); }) {}

std::size_t Calls::most(CallKind kind) const {
  return limits_.*kMaxCalls.at(static_cast<std::size_t>(kind));
}

Calls::~Calls() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  entered_.notify_all();
  looking_.join();
}

void Calls::open() {
  State starting = State::kStarting;  // one that drains by now stays closed
  state_.compare_exchange_strong(starting, State::kOpen);
}

void Calls::advance(State to) {
  State from = state_;
  while (from < to && !state_.compare_exchange_weak(from, to)) continue;
}

void Calls::require_within(State state, State last) {
  if (state == State::kStarting)
    throw Error(ErrorKind::kUnavailable, "the service is starting; wait until its health is SERVING");
  if (state > last) throw Error(ErrorKind::kUnavailable, "the service is shutting down; connect again later");
}

void Calls::require_open() const {
  require_within(state_, State::kMoving);
}

void Calls::require_staying() const {
  require_within(state_, State::kLeaving);
}

void Calls::require_ready() const {
  require_within(state_, State::kOpen);
}

void Calls::require_first_message(const char* field, Clock::time_point begun, Clock::time_point now) const {
  if (now - begun > std::chrono::duration<double>(limits_.first_message_s))
    throw Error(ErrorKind::kDeadline,
                fmt::format("{}: not sent within {} s; open a new stream", field, limits_.first_message_s));
}

std::unique_ptr<Calls::Ticket> Calls::enter(CallKind kind, std::weak_ptr<Served> call,
                                            const std::string& client) {
  const std::lock_guard lock(mutex_);
  const State state = state_;
  if (kind != CallKind::kInfo && (state == State::kStarting || state > State::kLeaving)) {
    ++refused(kind, state == State::kStarting ? Refusal::kStarting : Refusal::kDraining);
    require_within(state, State::kLeaving);
  }
  std::size_t same = 0, own = 0;
  for (const auto& [id, place] : places_) {
    if (place.kind != kind || !place.begun) continue;
    ++same;
    own += !client.empty() && place.client == client;
  }
  if (same >= most(kind)) {
    ++refused(kind, Refusal::kFull);
    throw Error(ErrorKind::kExhausted,
                fmt::format("all {} places for {} are taken; {}", same,
                            kCallNames[static_cast<std::size_t>(kind)], again(kind, same)));
  }
  if (own > 0 && own >= most(kind) - same) {
    ++refused(kind, Refusal::kClientShare);
    throw Error(
        ErrorKind::kExhausted,
        fmt::format("{} of {} {} are this client's, as many as are left for others; try again when one of "
                    "them has ended",
                    own, same, kCallNames[static_cast<std::size_t>(kind)]));
  }
  std::unique_ptr<Ticket> ticket(new Ticket(this, next_id_));
  places_.emplace(next_id_++, Place{kind, std::move(call), client, Clock::now()});
  entered_.notify_all();
  return ticket;
}

std::size_t Calls::count() const {
  const std::lock_guard lock(mutex_);
  return places_.size();
}

std::size_t Calls::count(CallKind kind) const {
  const std::lock_guard lock(mutex_);
  return static_cast<std::size_t>(
      std::ranges::count_if(places_, [kind](const auto& place) { return place.second.kind == kind; }));
}

void Calls::refused_authority(CallKind kind) {
  const std::lock_guard lock(mutex_);
  ++refused(kind, Refusal::kAuthority);
}

void Calls::refuse_for_load(std::uint64_t id, const std::string& load) {
  const std::lock_guard lock(mutex_);
  Place& refused_one = places_.at(id);
  refused_one.begun.reset();
  ++refused(refused_one.kind, Refusal::kLoad);
  const auto same = std::count_if(places_.begin(), places_.end(), [&](const auto& place) {
    return place.second.kind == refused_one.kind && place.second.begun;
  });
  throw Error(
      ErrorKind::kExhausted,
      load + "; " + again(refused_one.kind, std::max<std::size_t>(1, static_cast<std::size_t>(same))));
}

void Calls::ended(CallKind kind, grpc::StatusCode code) {
  const std::lock_guard lock(mutex_);
  ++counts_[static_cast<std::size_t>(kind)].ended[code];
}

std::array<Calls::Counts, kCallKinds> Calls::counts() const {
  const std::lock_guard lock(mutex_);
  auto counts = counts_;
  for (const auto& [id, place] : places_) ++counts[static_cast<std::size_t>(place.kind)].open;
  return counts;
}

void Calls::wait_until_none(Clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  left_.wait_until(lock, deadline, [this] { return places_.empty(); });
}

void Calls::look_after_calls() {
  std::vector<std::shared_ptr<Served>> calls;
  std::unique_lock lock(mutex_);
  for (auto next = Clock::now(); !stop_; next = std::max(next + kTick, Clock::now())) {
    entered_.wait_until(lock, next, [this] { return stop_; });
    entered_.wait(lock, [this] { return stop_ || !places_.empty(); });
    for (const auto& [id, place] : places_)
      if (auto call = place.call.lock()) calls.push_back(std::move(call));
    lock.unlock();
    const auto now = Clock::now();
    for (const auto& call : calls) call->look(now);
    calls.clear();  // not under the lock: some of them may have been ours alone by now
    lock.lock();
  }
}

}  // namespace teletact::service
