// The touch plane's decisions on a clock that is not the machine's: exchanges, whose turn it is, periods and
// admission, with workers that take their time and clients that misbehave. One seed is one course of events,
// always the same. Safety is looked at throughout, liveness once everybody behaves.
// Over 400 lines in one file: both tests play this one simulation.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <queue>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "service/base/seconds.h"
#include "service/scene/errors.h"
#include "service/touch_plane/touch_exchange.h"
#include "service/touch_plane/touch_queue.h"
#include "tests/support/number_in.h"

namespace teletact::service {
namespace {

using namespace std::chrono_literals;
using Time = TouchQueue::Time;
using Duration = TouchQueue::Clock::duration;
using Work = TouchExchange::Work;

enum class Habit {
  kHonest,
  kGreedy,
  kStopsReading,
  kCancels,
  kBursts,
  kNeverAcknowledges,
  kOutOfOrder,
  kHidesLongTurns
};

struct Client {
  Habit habit = Habit::kHonest;
  std::size_t principal = 0;
  TouchExchange::Terms terms;
  Duration takes{};  // a turn of it
  std::unique_ptr<TouchExchange> exchange;
  TouchQueue::Id id = 0;
  bool running = false, ended = false, left = false, hung = false;
  Time wanted = Time::max();                                               // its next turn
  std::uint64_t sent = 0, received = 0, brought = 0, told = 0, asked = 0;  // newest numbers
  Time joined{}, answered{};
  int pieces = 0;  // of laws, since
};

// Of one course of events, or of many, one after the other.
struct Plane {
  TouchQueue::Terms terms;
  Time now{1h};
  TouchQueue queue{terms, now};
};

Plane plane_of(std::uint64_t seed) {
  return Plane{{2 + seed % 3, seed % 2 == 0 ? 20.0 : 200.0}};
}

class Simulation {
 public:
  static constexpr Duration kFaultsEnd = 300ms, kSettled = 700ms, kEnd = 900ms;

  Simulation(std::uint64_t seed, Plane& plane) : random_(seed), plane_(plane) {
    for (int k = between(1, 4); k > 0; --k) weights_.push_back(one_in(3) ? TouchQueue::kObserverWeight : 1);
    long_turns_ = one_in(3);
    const bool busy = one_in(8);  // more to do than the workers can
    const int max_us = busy ? 1500 : 100;
    clients_.resize(static_cast<std::size_t>(busy ? between(12, 30) : between(1, 12)));
    for (std::size_t k = 0; k < clients_.size(); ++k) {
      Client& c = clients_[k];
      c.habit = static_cast<Habit>(between(0, 7));
      c.principal = static_cast<std::size_t>(between(0, static_cast<int>(weights_.size()) - 1));
      c.takes = long_turns_ && one_in(3) ? Duration(between(5, 30) * 1ms) : between(max_us / 4, max_us) * 1us;
      c.terms = {static_cast<std::uint64_t>(between(1, 8)), between(1, busy ? 3 : 20) * 1ms, one_in(3), 0.2,
                 60};
      at(begin_ + between(0, one_in(3) ? 600 : 100) * 1ms, [this, k] { come(k); });
    }
    at(begin_ + kFaultsEnd, [this] { behave(); });
  }

  // What was wrong first; none: nothing.
  std::optional<std::string> run() {
    while (!wrong_ && !events_.empty()) {
      const Event event = events_.top();
      events_.pop();
      now_ = event.at;
      event.happens();
      dispatch();
      if (now_ >= begin_ + kSettled && now_ < begin_ + kEnd) check_waiting();
    }
    if (!wrong_ && queue_.streams() > 0) fail("a stream did not leave");
    plane_.now = now_;
    return wrong_;
  }

  std::uint64_t answers = 0, longer = 0, refused = 0, weighed = 0;

 private:
  int between(int least, int most) {
    return least + static_cast<int>(random_() % static_cast<std::uint64_t>(most - least + 1));
  }
  bool one_in(int n) { return between(1, n) == 1; }
  bool faults() const { return now_ < begin_ + kFaultsEnd; }
  void at(Time time, std::function<void()> happens) { events_.push({time, ++happened_, std::move(happens)}); }
  void fail(std::string what) {
    if (!wrong_) wrong_ = fmt::format("{} (after {} us)", what, (now_ - begin_) / 1us);
  }
  TouchQueue::Principal principal_of(const Client& c) const {
    // Nobody was there in another course.
    return {fmt::format("{}/{}", begin_.time_since_epoch().count(), c.principal), weights_[c.principal]};
  }

  void come(std::size_t k) {
    Client& c = clients_[k];
    const auto is_long = [](const Client& one) {
      return one.takes > TouchQueue::kLong || one.habit == Habit::kHidesLongTurns;
    };
    const auto lengthened = [&](TouchQueue::TurnKind kind) { return std::isfinite(queue_.level_hz(kind)); };
    const auto kind = c.takes > TouchQueue::kLong ? TouchQueue::kLongTurns : TouchQueue::kShortTurns;
    if (queue_.overload(principal_of(c), kind, now_)) {
      ++refused;
      const bool has_long = std::ranges::any_of(clients_, [&](const Client& one) {
        return one.principal == c.principal && one.id != 0 && is_long(one);
      });
      if (!lengthened(kind) && !(has_long && lengthened(TouchQueue::kLongTurns)))
        fail("refused before periods were lengthened");
      return;
    }
    c.exchange = std::make_unique<TouchExchange>(c.terms, now_);
    c.id = queue_.join(principal_of(c), c.terms.period);
    by_id_[c.id] = k;
    c.joined = c.answered = now_;
    wake(c);
    send(k);
    if (c.habit == Habit::kCancels) at(now_ + between(0, 200) * 1ms, [this, k] { end(k); });
    at(begin_ + kEnd, [this, k] { end(k); });
  }

  // A client's poses, one after the other: with what it has received.
  void send(std::size_t k) {
    Client& c = clients_[k];
    if (c.ended) return;
    const bool bad = faults();
    const bool acknowledges = !bad || c.habit != Habit::kNeverAcknowledges;
    const std::uint64_t acknowledged = acknowledges ? c.received : 0;
    const bool in_order = !bad || c.habit != Habit::kOutOfOrder || !one_in(50);
    for (int n = bad && c.habit == Habit::kBursts ? 30 : 1; n > 0; --n) {
      const std::uint64_t sequence = in_order ? ++c.sent : c.sent;
      at(now_ + 20us, [this, k, sequence, acknowledged] { arrive(k, sequence, acknowledged); });
    }
    Duration pause = c.exchange->period();
    if (bad && c.habit == Habit::kGreedy) pause = between(100, 1000) * 1us;
    if (bad && c.habit == Habit::kBursts) pause = 50ms;
    at(now_ + pause, [this, k] { send(k); });
  }

  void arrive(std::size_t k, std::uint64_t sequence, std::uint64_t acknowledged) {
    Client& c = clients_[k];
    if (c.ended) return;
    try {
      c.exchange->pose({sequence, acknowledged, {}, {}}, now_);
      if (sequence <= c.brought) fail("a pose out of order was taken");
      c.brought = sequence;
      c.told = std::max(c.told, acknowledged);
    } catch (const std::invalid_argument&) {
      if (sequence > c.brought) fail("a pose in order was refused");
      return end(k);
    } catch (const Error&) {
      if (c.habit != Habit::kNeverAcknowledges && c.habit != Habit::kStopsReading)
        fail("a client that acknowledges was ended");
      return end(k);
    }
    wake(c);
  }

  void end(std::size_t k) {
    Client& c = clients_[k];
    if (std::exchange(c.ended, true)) return;
    c.exchange->end();
    wake(c);
  }

  void wake(Client& c) {
    const Time due = c.exchange->next(now_).due;
    queue_.wake(c.id, due, now_);
    c.wanted = std::min(c.wanted, due);
  }

  // What a turn takes of its own.
  Duration own_time(const Client& c, Work work) {
    if (work != Work::kAnswer) return 5us;
    if (faults() && c.habit == Habit::kHidesLongTurns && one_in(8)) return between(3, 40) * 1ms;
    return c.takes;
  }

  void dispatch() {
    while (busy_ < workers_) {
      const auto turn = queue_.begin(now_);
      if (!turn) break;
      const std::size_t k = by_id_.at(turn->id);
      Client& c = clients_[k];
      if (c.running) fail("two workers on one stream");
      if (c.left) fail("a turn after the last");
      if (turn->period < c.terms.period) fail("a shorter period than agreed");
      longer += turn->period > c.terms.period;
      c.running = true;
      c.wanted = Time::max();
      ++busy_;
      c.exchange->keep(turn->period);
      const Work work = c.exchange->begin(now_);
      const Duration own = own_time(c, work);
      Duration takes = own;
      if (faults() && one_in(500)) takes += between(1, 20) * 1ms;  // the machine's other work
      longest_ = std::max(longest_, takes);
      at(now_ + takes, [this, k, work, own, begun = now_] { finish(k, work, own, begun); });
    }
    const Time due = queue_.next_due();
    if (busy_ < workers_ && due < timer_) {
      timer_ = due;
      at(due, [this, due] {
        if (timer_ == due) timer_ = Time::max();
      });
    }
  }

  void finish(std::size_t k, Work work, Duration own, Time begun) {
    Client& c = clients_[k];
    c.running = false;
    --busy_;
    weigh(c, now_ - begun);
    if (work == Work::kOpen) c.exchange->opened(), write(k, 0);
    if (work == Work::kLawBefore || work == Work::kLaw) {
      ++c.pieces;
      const bool piece = one_in(4);
      c.exchange->law_sent(now_, piece, one_in(2));
      if (piece) write(k, 0);
    }
    if (work == Work::kAnswer) {
      const std::uint64_t pose = c.exchange->asked().pose.sequence;
      const std::uint64_t number = c.exchange->answered(now_, one_in(2));
      check_answer(c, pose, number);
      write(k, number);
    }
    c.left = work == Work::kLeave;
    const Time next = c.exchange->next(now_).due;
    queue_.done(c.id, now_, next, work == Work::kAnswer, own);
    c.wanted = std::min(c.wanted, next);
    if (c.left) queue_.leave(c.id);
  }

  // Over the network, to a client that may not read.
  void write(std::size_t k, std::uint64_t answer) {
    Client& c = clients_[k];
    if (faults() && c.habit == Habit::kStopsReading && one_in(10)) {
      c.hung = true;
      return;
    }
    at(now_ + between(10, 2000) * 1us, [this, k, answer] {
      Client& to = clients_[k];
      to.received = std::max(to.received, answer);
      to.exchange->written();
      if (!to.left) wake(to);
    });
  }

  // Faults are over: who had stopped reads on.
  void behave() {
    for (std::size_t k = 0; k < clients_.size(); ++k)
      if (std::exchange(clients_[k].hung, false)) write(k, clients_[k].exchange->counts().answers);
  }

  void check_answer(Client& c, std::uint64_t pose, std::uint64_t number) {
    ++answers;
    if (pose <= c.asked) fail("an older pose was answered after a newer one");
    c.asked = pose;
    if (number != c.exchange->counts().answers) fail("the answers are not counted one by one");
    if (number - c.told > c.terms.credit) fail("more answers unacknowledged than the credit");
    if (static_cast<double>(number) > (now_ - c.joined) / std::chrono::duration<double>(c.terms.period) + 2)
      fail("answers come sooner than the period");
    c.answered = now_;
    c.pieces = 0;
  }

  // A stream that wants answers gets one within three of its periods, and of what one turn of each stream of
  // each principal takes, by its weight. A piece of a law that comes between takes a turn of its own.
  void check_waiting() {
    Duration all{};
    double weight = 1;
    for (const Client& c : clients_)
      if (c.exchange && !c.left) all += c.takes;
    for (const double w : weights_) weight = std::min(weight, w);
    const auto round =
        std::chrono::duration_cast<Duration>(all * (static_cast<double>(weights_.size()) / weight));
    for (const Client& c : clients_) {
      if (!c.exchange || c.ended) continue;
      const Duration waits = now_ - std::max(c.answered, begin_ + kFaultsEnd);
      if (waits > 3 * (c.exchange->period() + round + 4ms) + c.pieces * round)
        fail(fmt::format("stream {} with a period of {} us waits for {} us", c.id, c.exchange->period() / 1us,
                         waits / 1us));
    }
  }

  bool waits(std::size_t principal) const {
    for (const Client& c : clients_)
      if (c.exchange && c.principal == principal && !c.running && !c.left && c.wanted <= now_ &&
          c.exchange->counts().answers > 1)
        return true;
    return false;
  }

  // While two principals both have turns to wait for, neither gets more of the workers' time for its weight,
  // but for a slice and the turns that run. Long turns may have to wait for each other instead.
  void weigh(const Client& served, Duration took) {
    if (long_turns_ || longest_ > TouchQueue::kLong) return shares_.clear();
    const double s = std::chrono::duration<double>(took).count();
    for (std::size_t other = 0; other < weights_.size(); ++other) {
      const std::size_t own = served.principal;
      if (other == own) continue;
      const auto pair = std::minmax(own, other);
      if (!waits(own) || !waits(other)) {
        shares_.erase(pair);
        continue;
      }
      double& ahead = shares_[pair];  // the first of the two, over the weights
      ahead += (own < other ? s : -s) / weights_[own];
      ++weighed;
      const double turn_s = std::chrono::duration<double>(longest_).count();
      const double least = std::min(weights_[own], weights_[other]);
      if (std::abs(ahead) > 2 * TouchQueue::kSliceS + 2 * static_cast<double>(workers_) * turn_s / least)
        fail(fmt::format("a principal is {:.1f} ms ahead of another that waits", 1e3 * std::abs(ahead)));
    }
  }

  struct Event {
    Time at;
    std::uint64_t number;
    std::function<void()> happens;
    bool operator>(const Event& other) const {
      return std::pair(at, number) > std::pair(other.at, other.number);
    }
  };
  std::mt19937_64 random_;
  Plane& plane_;
  TouchQueue& queue_ = plane_.queue;
  const Time begin_ = plane_.now;
  Time now_ = begin_;
  const std::size_t workers_ = plane_.terms.workers;
  std::size_t busy_ = 0;
  bool long_turns_ = false;
  Duration longest_{};
  std::vector<double> weights_;  // of the principals
  std::vector<Client> clients_;
  std::map<TouchQueue::Id, std::size_t> by_id_;
  std::map<std::pair<std::size_t, std::size_t>, double> shares_;
  std::priority_queue<Event, std::vector<Event>, std::greater<>> events_;
  std::uint64_t happened_ = 0;
  Time timer_ = Time::max();  // of the workers
  std::optional<std::string> wrong_;
};

// TELETACT_SEEDS=N: so many; TELETACT_SEED=K: that one alone.
TEST(TouchPlane, KeepsItsPromisesToClientsThatDoNotKeepTheirs) {
  const std::uint64_t one = test::number_in("TELETACT_SEED", 0);
  const std::uint64_t first = one ? one : 1, last = one ? one : test::number_in("TELETACT_SEEDS", 2000);
  std::uint64_t answers = 0, longer = 0, refused = 0, weighed = 0;
  for (std::uint64_t seed = first; seed <= last; ++seed) {
    Plane plane = plane_of(seed);
    Simulation simulation(seed, plane);
    if (const auto wrong = simulation.run()) {
      FAIL() << "seed " << seed << ": " << *wrong << "; again with TELETACT_SEED=" << seed;
    }
    answers += simulation.answers, longer += simulation.longer;
    refused += simulation.refused, weighed += simulation.weighed;
  }
  fmt::print("seeds {} to {}: {} answers, {} turns at a longer period, {} refused, {} weighed\n", first, last,
             answers, longer, refused, weighed);
  if (one) return;
  // What is promised was put to the test.
  EXPECT_GT(answers, 20 * last);
  EXPECT_GT(longer, 0u);
  EXPECT_GT(refused, 0u);
  EXPECT_GT(weighed, last);
}

// TELETACT_SIMULATED_S=N: for so long on its clock. What tables and the allocator keep for the next course is
// there after the first quarter; everybody has left when it is looked at.
TEST(TouchPlane, HoldsNoMoreAfterManyCoursesOfEvents) {
  constexpr std::size_t kNothing = 8 << 10;  // bytes: less than a pointer lost with each principal
  const std::chrono::seconds all{test::number_in("TELETACT_SIMULATED_S", 300)};
  for (const std::uint64_t first : {1u, 2u}) {
    Plane plane = plane_of(first);
    const Time begin = plane.now;
    std::size_t early = 0, late = 0, courses = 0;
    for (std::uint64_t seed = first; plane.now < begin + all; ++seed, ++courses) {
      if (const auto wrong = Simulation(seed, plane).run())
        FAIL() << "plane " << first << ", course " << courses << ": " << *wrong;
      std::size_t& most = plane.now < begin + all / 4 ? early : late;
      most = std::max(most, mallinfo2().uordblks);
    }
    EXPECT_LE(late, early + kNothing) << "plane " << first;
    fmt::print("plane {}: {} courses in {} s of its clock, {} bytes held, then {}\n", first, courses,
               (plane.now - begin) / 1s, early, late);
  }
}

}  // namespace
}  // namespace teletact::service
