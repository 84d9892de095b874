// Whose turn it is: the touch plane's order of streams, without its threads and without a clock of its own.
//
// A stream asks for a turn at a time. Of the turns that are due, those of the principal (a client) go first
// that has had least of the workers' time for its weight, and within a principal that with the earliest
// deadline, which is a period after it was due. Principals that have had about the same go by deadlines. One
// that comes anew starts level with those that are served: nobody saves up. Among long turns what a principal
// has had of those decides, since short ones may have had much meanwhile.
//
// A stream is worked on by one worker at a time. Turns that are expected to be long are given to all workers
// but one: a short one waits for none of them. Expected are they of a stream of which two of the last eight
// were, so that one that was held up once makes none. And for a while of all streams of a principal that had
// a turn which others waited for, though it was not expected to be long.
//
// When there is more to do than workers can, periods become longer, of whoever has most first
// (TouchLoad). When they are as long as they may be, another stream has no room. Short turns and long ones
// do not wait for the same workers, so each kind has a load of its own.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <unordered_map>
#include <utility>

namespace teletact::service {

// How many answers a second the touch plane gives one principal at most: as many as asked for, until turns
// that are due wait without end; then fewer to whoever has most, and more again by steps. So whoever asks for
// little is served as asked, and all that ask for more are served alike. The level stays near what the
// busiest has: where its periods are as long as they may be, a lower one would slow down the others alone.
// Time passes in windows of kWindow.
class TouchLoad {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kWindow{100};
  static constexpr unsigned kStands = 2;  // windows in a row without an end of what waits: no accident
  static constexpr double kLess = 0.9, kMore = 1.02;  // of what was answered; of the level, each window
  static constexpr unsigned kEases = 10;              // windows in a row without it: the load has changed,
  static constexpr double kMuchMore = 1.1;            // and the level is not near any more
  static constexpr double kForgets = 0.95;  // a window in which the machine did other work says little
  static constexpr double kReleased = 1.5;  // times what the busiest has: it holds nobody back

  // Nothing waits now that a worker could do.
  void caught_up() { stands_ = false; }
  // A window is over, in which the busiest principal had so many answers a second for its weight.
  void settle(double busiest_hz) {
    lately_hz_ = std::max(busiest_hz, kForgets * lately_hz_);
    standing_ = stands_ ? standing_ + 1 : 0;
    eases_ = stands_ ? 0 : eases_ + 1;
    if (standing_ >= kStands && busiest_hz > 0) {  // without an answer there is nothing to measure it by
      level_hz_ = kLess * std::max(std::min(level_hz_, lately_hz_), busiest_hz);
      standing_ = 0;
    } else if (!stands_) {
      level_hz_ *= eases_ > kEases ? kMuchMore : kMore;
      if (level_hz_ > kReleased * busiest_hz) level_hz_ = kNone;
    }
    stands_ = true;
  }
  // For a weight of 1; infinity: as many as are asked for.
  double level_hz() const { return level_hz_; }

 private:
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  double level_hz_ = kNone, lately_hz_ = 0;
  bool stands_ = false;  // so far, in this window
  unsigned standing_ = 0, eases_ = 0;
};

class TouchQueue {
 public:
  using Clock = std::chrono::steady_clock;
  using Time = Clock::time_point;
  using Id = std::uint64_t;                              // never 0
  static constexpr double kSliceS = 0.001;               // of time served: less is no difference
  static constexpr std::chrono::milliseconds kLong{2};   // a turn that takes more of its own
  static constexpr auto kBlocks = 10 * kLong;            // others waited for a turn that took more
  static constexpr std::chrono::seconds kDistrusted{2};  // so long its principal's count as long
  static constexpr double kObserverWeight = 0.25;        // who steers no probe slows down first

  enum TurnKind : std::size_t { kShortTurns, kLongTurns };

  struct Terms {
    std::size_t workers = 2;  // at least
    double min_rate_hz = 20;  // no period becomes longer than this says
  };
  struct Principal {
    std::string name;
    double weight = 1;  // that of its first stream counts
  };
  struct Turn {
    Id id = 0;
    Clock::duration period{};  // that is kept now
  };

  TouchQueue(const Terms& terms, Time now) : terms_(terms), settled_(now) {}

  // What speaks against one more stream, in words with the load; none: there is room. `kind`: what its turns
  // are expected to be, unless most of the same principal's have been long.
  std::optional<std::string> overload(const Principal&, TurnKind kind, Time now);
  // `period`: between its answers, as agreed.
  Id join(const Principal&, Clock::duration period);
  // Not while its turn runs, but by done().
  void leave(Id);
  // A turn at `due`, or earlier if that was asked for before. Does nothing for one that has left.
  void wake(Id, Time due, Time now);
  // The next turn; none: nothing is due, or what is due must wait.
  std::optional<Turn> begin(Time now);
  // A turn is over; `next`: as wake(). `answered`: a pose was answered. `own`: what the machine's other work
  // took of its time left out.
  void done(Id, Time now, Time next, bool answered, Clock::duration own = Clock::duration::max());
  // When begin() may have one that it has not now, as far as is known; Time::max(): not before another call.
  Time next_due() const { return timers_.empty() ? Time::max() : timers_.begin()->first; }
  bool any_ready() const {
    return !order_[kShortTurns].empty() || (!order_[kLongTurns].empty() && long_may_run());
  }

  Clock::duration period(Id) const;  // that is kept now
  double level_hz(TurnKind kind) const { return load_[kind].level_hz(); }
  std::size_t streams() const { return streams_.size(); }

 private:
  enum class State { kIdle, kTimed, kReady, kRunning };
  template <class T>
  using ByKind = std::array<T, 2>;  // of TurnKind
  struct Account;
  using Order = std::tuple<std::int64_t, Time, Id>;  // slice of time served, deadline, stream
  static Order order(double served_s, const std::pair<Time, Id>& first);
  struct Stream {
    Account* account = nullptr;
    Clock::duration period{};
    State state = State::kIdle;
    Time due = Time::max();  // kTimed: of its turn; kRunning: of the next, as was asked for meanwhile
    Time deadline{}, begun{};
    Clock::duration last = Clock::duration::max();  // its turn took; max(): none was answered yet
    std::uint8_t long_turns = 0;                    // of the last eight, a bit each; the first counts twice
    TurnKind kind = kLongTurns;                     // as it became ready
    Clock::duration charged{};
    double answers = 0;  // in this window
    bool expected_long() const { return last == Clock::duration::max() || std::popcount(long_turns) > 1; }
  };
  struct Account {
    double weight = 1, served_s = 0;  // over the weight
    ByKind<double> served_in_s{};     // likewise, of turns of a kind
    std::size_t streams = 0;
    ByKind<std::size_t> running{};
    ByKind<double> active{};  // so many streams, answered alike, would have had the last window's answers
    ByKind<double> answers{}, squares{};          // while a window is settled
    ByKind<std::set<std::pair<Time, Id>>> ready;  // by deadline
    ByKind<std::optional<Order>> order;           // as it stands in order_
    Time distrusted_until = Time::min();
    void serve(TurnKind kind, double s) { served_s += s / weight, served_in_s[kind] += s / weight; }
    bool idle_in(TurnKind kind) const { return ready[kind].empty() && running[kind] == 0; }
  };
  bool long_may_run() const { return long_running_ + 1 < terms_.workers; }
  bool mostly_long(const Account&) const;
  Clock::duration kept(const Stream&) const;
  void set_due(Id, Stream&, Time due, Time now);
  void make_ready(Id, Stream&, Time ready);
  void come(Account&, TurnKind);
  TurnKind next_kind() const;
  void reorder(Account&, TurnKind);
  void distrust(Account&, Time now);
  void look(Time now);  // at what has become due, and at the windows that are over
  void settle(Time now);

  const Terms terms_;
  ByKind<TouchLoad> load_;
  Time settled_;  // the last window
  std::unordered_map<Id, Stream> streams_;
  std::map<std::string, Account> accounts_;   // by principal; each has a stream
  std::set<std::pair<Time, Id>> timers_;      // turns that are not due
  ByKind<std::set<Order>> order_;             // principals with turns that are due
  double level_s_ = 0;                        // where a principal that comes anew starts: of all its
  ByKind<double> level_in_s_{};               // time, and of that of a kind
  std::size_t long_running_ = 0, fresh_ = 0;  // the latter: joined since the last window
  ByKind<double> active_{};                   // of all
  Id last_ = 0;
};

}  // namespace teletact::service
