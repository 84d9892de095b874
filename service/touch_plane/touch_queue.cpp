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

std::optional<std::string> TouchQueue::overload(const Principal& principal, TurnKind kind, Time now) {
  look(now);  // there may be nobody left who takes turns
  double own = 0, weight = principal.weight;
  if (const auto known = accounts_.find(principal.name); known != accounts_.end()) {
    const Account& account = known->second;
    if (mostly_long(account)) kind = kLongTurns;
    own = std::max(1.0, account.active[kind]);
    weight = account.weight;
  }
  if (streams_.empty() || !std::isfinite(level_hz(kind))) return std::nullopt;
  // Those that have just joined are not seen in the level yet.
  const double before = std::max(1.0, active_[kind]), fresh = static_cast<double>(fresh_);
  const double share_hz = level_hz(kind) * before / (before + fresh + 1);
  const double rate_hz = weight * share_hz / (own + 1);
  if (rate_hz >= terms_.least_rate_hz) return std::nullopt;
  return fmt::format(
      "{} touch streams are answered as often as can be: another one would be {:.1f} times a second, and "
      "less than {:g} (least_touch_rate_hz) serves nobody",
      streams_.size(), rate_hz, terms_.least_rate_hz);
}

bool TouchQueue::mostly_long(const Account& account) const {
  int more = 0;
  for (const auto& [id, stream] : streams_)
    if (stream.account == &account && stream.last < Clock::duration::max())
      more += stream.kind() == kLongTurns ? 1 : -1;
  return more > 0;
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
    const TurnKind kind = stream.kind();
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
  const TurnKind kind = stream.kind();
  const double share_hz =
      stream.account->weight * level_hz(kind) / std::max(1.0, stream.account->active[kind]);
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
  const TurnKind kind = stream.kind();
  account.ready[kind].emplace(stream.deadline, id);
  reorder(account, kind);
}

void TouchQueue::reorder(Account& account, TurnKind kind) {
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

void TouchQueue::look(Time now) {
  if (now - settled_ >= TouchLoad::kWindow) settle(now);
  while (next_due() <= now) {
    const auto [due, id] = *timers_.begin();
    timers_.erase(timers_.begin());
    make_ready(id, streams_.at(id), due);
  }
  for (const TurnKind kind : {kShortTurns, kLongTurns})
    if (order_[kind].empty()) load_[kind].caught_up();
}

std::optional<TouchQueue::Turn> TouchQueue::begin(Time now) {
  look(now);
  if (!any_ready()) return std::nullopt;
  const std::set<Order>&short_ones = order_[kShortTurns], &long_ones = order_[kLongTurns];
  const TurnKind kind =
      short_ones.empty() || (!long_ones.empty() && long_may_run() && *long_ones.begin() < *short_ones.begin())
          ? kLongTurns
          : kShortTurns;
  Account& account = *by_id_.at(std::get<2>(*order_[kind].begin()));
  const Id id = account.ready[kind].begin()->second;
  account.ready[kind].erase(account.ready[kind].begin());
  Stream& stream = streams_.at(id);
  stream.state = State::kRunning;
  stream.begun = now;
  long_running_ += kind == kLongTurns;
  ++account.running;
  level_s_ = std::max(level_s_, account.served_s);
  // About what it will take is charged at once: the next worker sees it.
  stream.charged = stream.last == Clock::duration::max() ? Clock::duration{} : stream.last;
  account.served_s += in_seconds(stream.charged) / account.weight;
  for (const TurnKind each : {kShortTurns, kLongTurns}) reorder(account, each);
  return Turn{id, kept(stream)};
}

void TouchQueue::done(Id id, Time now, Time next, bool answered) {
  Stream& stream = streams_.at(id);
  Account& account = *stream.account;
  const Clock::duration took = now - stream.begun;
  long_running_ -= stream.kind() == kLongTurns;
  --account.running;
  account.served_s += in_seconds(took - stream.charged) / account.weight;
  for (const TurnKind each : {kShortTurns, kLongTurns}) reorder(account, each);
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
    Account& account = *stream.account;
    account.answers[stream.kind()] += stream.answers;
    account.squares[stream.kind()] += stream.answers * stream.answers;
    stream.answers = 0;
  }
  for (const TurnKind kind : {kShortTurns, kLongTurns}) {
    double busiest_hz = 0;
    active_[kind] = 0;
    for (auto& [name, account] : accounts_) {
      const double answers = std::exchange(account.answers[kind], 0);
      const double squares = std::exchange(account.squares[kind], 0);
      busiest_hz = std::max(busiest_hz, answers / (passed_s * account.weight));
      account.active[kind] = answers > 0 ? answers * answers / squares : 0;
      active_[kind] += account.active[kind];
    }
    load_[kind].settle(busiest_hz);
  }
  fresh_ = 0;
  settled_ = now;
}

}  // namespace teletact::service
