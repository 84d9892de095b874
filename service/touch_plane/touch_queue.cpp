#include "service/touch_plane/touch_queue.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "service/base/seconds.h"

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
  if (rate_hz >= terms_.min_rate_hz) return std::nullopt;
  return fmt::format(
      "{} touch streams are answered as often as possible: another one would get {:.1f} answers a second, "
      "and at least {:g} (min_touch_rate_hz) are needed; try again when a touch has ended",
      streams_.size(), rate_hz, terms_.min_rate_hz);
}

bool TouchQueue::mostly_long(const Account& account) const {
  int more = 0;
  for (const auto& [id, stream] : streams_)
    if (stream.account == &account && stream.last < Clock::duration::max())
      more += stream.expected_long() ? 1 : -1;
  return more > 0;
}

TouchQueue::Id TouchQueue::join(const Principal& principal, Clock::duration period) {
  const auto [at, comes_anew] = accounts_.try_emplace(principal.name);
  Account& account = at->second;
  if (comes_anew) account.weight = principal.weight;
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
    account.ready[stream.kind].erase({stream.deadline, id});
    reorder(account, stream.kind);
  }
  streams_.erase(found);
  if (--account.streams > 0) return;
  std::erase_if(accounts_, [&](const auto& entry) { return &entry.second == &account; });
}

TouchQueue::Clock::duration TouchQueue::kept(const Stream& stream) const {
  const double share_hz =
      stream.account->weight * level_hz(stream.kind) / std::max(1.0, stream.account->active[stream.kind]);
  const double longer_s = 1 / std::max(share_hz, terms_.min_rate_hz);
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
  stream.state = State::kReady;
  stream.due = Time::max();
  stream.kind = stream.expected_long() || ready < account.distrusted_until ? kLongTurns : kShortTurns;
  stream.deadline = ready + kept(stream);
  come(account, stream.kind);
  account.ready[stream.kind].emplace(stream.deadline, id);
  reorder(account, stream.kind);
}

// One that had nothing to do has saved up nothing.
void TouchQueue::come(Account& account, TurnKind kind) {
  const auto at_least = [](double& served_s, double level_s) {
    served_s = std::max(served_s, level_s - kSliceS);
  };
  if (account.idle_in(kShortTurns) && account.idle_in(kLongTurns)) at_least(account.served_s, level_s_);
  if (account.idle_in(kind)) at_least(account.served_in_s[kind], level_in_s_[kind]);
}

TouchQueue::Order TouchQueue::order(double served_s, const std::pair<Time, Id>& first) {
  return {std::llround(std::floor(served_s / kSliceS)), first.first, first.second};
}

void TouchQueue::reorder(Account& account, TurnKind kind) {
  auto& place = account.order[kind];
  std::optional<Order> now;
  if (!account.ready[kind].empty()) now = order(account.served_in_s[kind], *account.ready[kind].begin());
  if (now == place) return;
  if (place) order_[kind].erase(*place);
  if (now) order_[kind].insert(*now);
  place = now;
}

void TouchQueue::distrust(Account& account, Time now) {
  account.distrusted_until = now + kDistrusted;
  if (account.ready[kShortTurns].empty()) return;
  come(account, kLongTurns);
  for (const auto& [deadline, id] : account.ready[kShortTurns]) streams_.at(id).kind = kLongTurns;
  account.ready[kLongTurns].merge(account.ready[kShortTurns]);
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

// Of the first of each kind, whose principal has had less in all; something is ready.
TouchQueue::TurnKind TouchQueue::next_kind() const {
  if (order_[kShortTurns].empty()) return kLongTurns;
  if (order_[kLongTurns].empty() || !long_may_run()) return kShortTurns;
  const auto in_all = [&](TurnKind kind) {
    const Account& account = *streams_.at(std::get<Id>(*order_[kind].begin())).account;
    return order(account.served_s, *account.ready[kind].begin());
  };
  return in_all(kLongTurns) < in_all(kShortTurns) ? kLongTurns : kShortTurns;
}

std::optional<TouchQueue::Turn> TouchQueue::begin(Time now) {
  look(now);
  if (!any_ready()) return std::nullopt;
  const TurnKind kind = next_kind();
  const Id id = std::get<Id>(*order_[kind].begin());
  Stream& stream = streams_.at(id);
  Account& account = *stream.account;
  account.ready[kind].erase({stream.deadline, id});
  stream.state = State::kRunning;
  stream.begun = now;
  long_running_ += kind == kLongTurns;
  ++account.running[kind];
  level_s_ = std::max(level_s_, account.served_s);
  level_in_s_[kind] = std::max(level_in_s_[kind], account.served_in_s[kind]);
  // About what it will take is charged at once: the next worker sees it.
  stream.charged = stream.last == Clock::duration::max() ? Clock::duration{} : stream.last;
  account.serve(kind, in_seconds(stream.charged));
  reorder(account, kind);
  return Turn{id, kept(stream)};
}

void TouchQueue::done(Id id, Time now, Time next, bool answered, Clock::duration own) {
  Stream& stream = streams_.at(id);
  Account& account = *stream.account;
  const Clock::duration took = now - stream.begun;
  long_running_ -= stream.kind == kLongTurns;
  --account.running[stream.kind];
  const double uncharged_s = in_seconds(took - stream.charged);
  account.serve(stream.kind, uncharged_s);
  if (stream.last == Clock::duration::max())  // of which kind they will be is not known yet
    account.served_in_s[stream.kind == kLongTurns ? kShortTurns : kLongTurns] += uncharged_s / account.weight;
  own = std::min(own, took);
  if (own > kBlocks && !stream.expected_long()) distrust(account, now);
  for (const TurnKind each : {kShortTurns, kLongTurns}) reorder(account, each);
  if (answered) {
    const bool first = std::exchange(stream.last, took) == Clock::duration::max();
    const unsigned was_long = own > kLong ? 1 : 0;
    stream.long_turns = static_cast<std::uint8_t>((first ? was_long : stream.long_turns) << 1 | was_long);
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
    account.answers[stream.kind] += stream.answers;
    account.squares[stream.kind] += stream.answers * stream.answers;
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
