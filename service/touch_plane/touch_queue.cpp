#include "service/touch_plane/touch_queue.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "service/limits/seconds.h"

namespace teletact::service {

namespace {

double in_seconds(TouchQueue::Clock::duration duration) {
  return std::chrono::duration<double>(duration).count();
}

}  // namespace

std::optional<std::string> TouchQueue::overload(const Principal& principal) const {
  if (!std::isfinite(load_.level_hz())) return std::nullopt;
  const auto known = accounts_.find(principal.name);
  const double own = known == accounts_.end() ? 0 : known->second.active;
  const double weight = known == accounts_.end() ? principal.weight : known->second.weight;
  // Those that have just joined are not seen in the level yet.
  const double before = std::max(1.0, active_), fresh = static_cast<double>(fresh_);
  const double level_hz = load_.level_hz() * before / (before + fresh + 1);
  const double rate_hz = weight * level_hz / (own + 1);
  if (rate_hz >= terms_.least_rate_hz) return std::nullopt;
  return fmt::format(
      "{} touch streams are answered as often as can be: another one would be {:.1f} times a second, and "
      "less "
      "than {:g} (least_touch_rate_hz) serves nobody",
      streams_.size(), rate_hz, terms_.least_rate_hz);
}

TouchQueue::Id TouchQueue::join(const Principal& principal, Clock::duration period) {
  const auto [at, comes_anew] = accounts_.try_emplace(principal.name);
  Account& account = at->second;
  if (comes_anew) {
    account.id = ++last_;
    account.weight = principal.weight;
    by_id_[account.id] = &account;
  }
  ++account.streams;
  ++fresh_;
  Stream& stream = streams_[++last_];
  stream.account = &account;
  stream.period = period;
  return last_;
}

void TouchQueue::leave(Id id) {
  const auto found = streams_.find(id);
  if (found == streams_.end()) return;
  Stream& stream = found->second;
  Account& account = *stream.account;
  if (stream.state == State::kTimed) timers_.erase({stream.due, id});
  if (stream.state == State::kReady) {
    const std::size_t kind = stream.is_long();
    account.ready[kind].erase({stream.deadline, id});
    reorder(account, kind);
  }
  streams_.erase(found);
  if (--account.streams > 0) return;
  by_id_.erase(account.id);
  const auto own = std::find_if(accounts_.begin(), accounts_.end(),
                                [&](const auto& entry) { return &entry.second == &account; });
  accounts_.erase(own);
}

TouchQueue::Clock::duration TouchQueue::kept(const Stream& stream) const {
  const double share_hz = stream.account->weight * load_.level_hz() / stream.account->active;
  const double longer_s = 1 / std::max(share_hz, terms_.least_rate_hz);
  return std::max(stream.period, seconds(longer_s));
}

TouchQueue::Clock::duration TouchQueue::period(Id id) const {
  return kept(streams_.at(id));
}

void TouchQueue::wake(Id id, Time due, Time now) {
  const auto found = streams_.find(id);
  if (found != streams_.end() && due < Time::max()) set_due(id, found->second, due, now);
}

void TouchQueue::set_due(Id id, Stream& stream, Time due, Time now) {
  if (stream.state == State::kReady || due >= stream.due) return;
  if (stream.state == State::kTimed) timers_.erase({stream.due, id});
  stream.due = due;
  if (stream.state == State::kRunning) return;
  if (due <= now) return make_ready(id, stream, now);
  stream.state = State::kTimed;
  timers_.emplace(due, id);
}

void TouchQueue::make_ready(Id id, Stream& stream, Time ready) {
  Account& account = *stream.account;
  if (!account.waits() && account.running == 0)
    account.served_s = std::max(account.served_s, level_s_ - kSliceS);
  stream.state = State::kReady;
  stream.due = Time::max();
  stream.deadline = ready + kept(stream);
  const std::size_t kind = stream.is_long();
  account.ready[kind].emplace(stream.deadline, id);
  reorder(account, kind);
}

void TouchQueue::reorder(Account& account, std::size_t kind) {
  auto& place = account.order[kind];
  std::optional<Order> now;
  if (!account.ready[kind].empty())
    now = Order(std::llround(std::floor(account.served_s / kSliceS)), account.ready[kind].begin()->first,
                account.id);
  if (now == place) return;
  if (place) order_[kind].erase(*place);
  if (now) order_[kind].insert(*now);
  place = now;
}

std::optional<TouchQueue::Turn> TouchQueue::begin(Time now) {
  if (now - settled_ >= TouchLoad::kWindow) settle(now);
  while (next_due() <= now) {
    const auto [due, id] = *timers_.begin();
    timers_.erase(timers_.begin());
    make_ready(id, streams_.at(id), due);
  }
  if (!any_ready()) {
    load_.caught_up();
    return std::nullopt;
  }
  const bool of_long =
      order_[0].empty() || (!order_[1].empty() && long_may_run() && *order_[1].begin() < *order_[0].begin());
  Account& account = *by_id_.at(std::get<2>(*order_[of_long].begin()));
  const Id id = account.ready[of_long].begin()->second;
  account.ready[of_long].erase(account.ready[of_long].begin());
  Stream& stream = streams_.at(id);
  stream.state = State::kRunning;
  stream.begun = now;
  long_running_ += of_long;
  ++account.running;
  level_s_ = std::max(level_s_, account.served_s);
  // About what it will take is charged at once: the next worker sees it.
  stream.charged = stream.last == Clock::duration::max() ? Clock::duration{} : stream.last;
  account.served_s += in_seconds(stream.charged) / account.weight;
  for (const std::size_t kind : {0, 1}) reorder(account, kind);
  return Turn{id, kept(stream)};
}

void TouchQueue::done(Id id, Time now, Time next, bool answered) {
  Stream& stream = streams_.at(id);
  Account& account = *stream.account;
  const Clock::duration took = now - stream.begun;
  long_running_ -= stream.is_long();
  --account.running;
  account.served_s += in_seconds(took - stream.charged) / account.weight;
  for (const std::size_t kind : {0, 1}) reorder(account, kind);
  if (answered) {
    stream.before = std::exchange(stream.last, took);
    ++stream.answers;
  }
  stream.state = State::kIdle;
  const Time due = std::min(next, std::exchange(stream.due, Time::max()));
  if (due < Time::max()) set_due(id, stream, due, now);
}

// A window is over.
void TouchQueue::settle(Time now) {
  const double passed_s = in_seconds(now - settled_);
  for (auto& [id, stream] : streams_) {
    stream.account->answers += stream.answers;
    stream.account->squares += stream.answers * stream.answers;
    stream.answers = 0;
  }
  double busiest_hz = 0;
  active_ = 0, fresh_ = 0;
  for (auto& [name, account] : accounts_) {
    busiest_hz = std::max(busiest_hz, account.answers / (passed_s * account.weight));
    account.active = account.answers > 0 ? account.answers * account.answers / account.squares : 1;
    active_ += account.active;
    account.answers = account.squares = 0;
  }
  load_.settle(busiest_hz);
  settled_ = now;
}

}  // namespace teletact::service
