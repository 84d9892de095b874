// Who works next: the imaging plane's order of jobs, without its threads and without a clock of its own.
//
// Clients share the time fairly. Each has an account of the seconds that it was served; the one with least
// goes first, and a job that runs makes way once its client is kSlice ahead of another that waits. A client
// that comes anew starts level with those that are served: nobody saves up. Within one client the job with
// the earliest deadline goes first and is finished before the next begins.
//
// What the service owes (a stale neighbour's refresh) runs while nobody asks for anything, and when its
// deadline comes near before everybody. It is charged to the client that caused it.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace teletact::service {

struct JobTerms {
  using Time = std::chrono::steady_clock::time_point;
  std::string client;           // who is charged
  Time deadline = Time::max();  // done by then, or not worth doing; of what is owed: promised for then
  double cost_s = 0;            // about so long it will work
  bool owed = false;            // nobody waits for it
};

class FairQueue {
 public:
  using Time = JobTerms::Time;
  using Id = std::uint64_t;  // never 0
  static constexpr double kSliceS = 0.05;
  static constexpr std::size_t kMaxWaiting = 64;           // of all clients, owed ones aside
  static constexpr std::size_t kMaxWaitingPerClient = 16;  // of one
  // Each holds its memory; owed ones aside. More than there are places for estimates: a new scene never waits
  // for the end of a long one.
  static constexpr std::size_t kMaxBegun = 16;
  // A client that was served so lately may come back at any moment: promises count on it.
  static constexpr std::chrono::seconds kLately{2};

  // Throws Error(kExhausted) when too many wait.
  Id add(const JobTerms&, Time now);
  // The job whose turn it is, begun or not. Empty when none may run.
  std::optional<Id> next(Time now) const;
  // Whether `running` is to make way for another.
  bool makes_way(Id running, Time now) const;
  // `id` can do nothing before `other` has ended: its turns are the other's until then.
  void wait(Id id, Id other);
  void begun(Id);
  void served(Id, double seconds, Time now);
  void ended(Id, Time now);
  // Not yet begun, and past their deadlines; owed ones never are.
  std::vector<Id> expired(Time now) const;
  // When a job on these terms would be done if it were added now, in seconds, should everybody who is here,
  // or was lately, want as much.
  double done_in_s(const JobTerms&, Time now) const;
  bool empty() const { return jobs_.empty(); }

 private:
  struct Job {
    JobTerms terms;
    bool begun = false;
    double left_s = 0;
    Id waits_for = 0;
  };
  struct Account {
    double served_s = 0;
    std::size_t jobs = 0, waiting = 0;  // owed ones aside
    Time lately;
  };
  bool due(const Job&, Time now) const;
  std::optional<Id> first(Time now) const;
  Id who_acts_for(Id) const;
  std::optional<Id> next_owed(Time now, bool due_only) const;
  std::optional<Id> next_of(const std::string& client) const;
  Account& account(const std::string& client, Time now);
  void forget_the_gone(Time now);
  std::map<Id, Job> jobs_;
  std::map<std::string, Account> accounts_;
  std::size_t waiting_ = 0, begun_ = 0;  // owed ones aside
  double level_s_ = 0;                   // where a client that comes anew starts
  Id last_ = 0;
};

}  // namespace teletact::service
