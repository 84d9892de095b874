// Whose turn it is: the order of jobs that take turns, without threads, network or a clock of its own (time
// is an argument). Workers (workers.h) do what it says. One schedule has several devices; each has its own
// order, and one job works with it at a time. A device that is to work on several at once stands here as many
// times (ImagingPlane).
//
// Shares. Each client has an account of the seconds that it was served by a device; the one with least goes
// first. A client that comes anew starts level with those that are served: nobody saves up.
//
// Within a client what was begun is finished before the next begins, then the earliest deadline goes first,
// then what came first.
//
// Giving way. A job that runs makes way once its client is kSliceS ahead of another that waits. Jobs in the
// background (disk, layers for touch) are never interrupted. Each is charged a slice, whatever it takes:
// their clients take turns.
//
// What the service owes (a stale neighbour's refresh) runs while nobody asks for anything, and when its
// deadline comes near before everybody. It is charged to the client that caused it. One owed job after the
// other.
//
// Scenes. A job that changes a scene has it alone, whatever its device. While another has it, a job that
// needs it gives its turns to that one; where that one is another device's, its own device goes on with other
// jobs.
//
// Refusal. A device has bounds: jobs that wait, of a client and of all, and jobs that were begun, which hold
// memory. done_in_s() says when a job could be done, before it is added. What has not begun by its deadline
// has expired.
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
  bool background = false;      // not interrupted; who posts bounds how many wait
  std::size_t device = 0;       // whose turns it takes
};

class Schedule {
 public:
  using Time = JobTerms::Time;
  using Id = std::uint64_t;  // never 0
  static constexpr double kSliceS = 0.05;
  // Of each device, and of each of its turns where it has several; what is owed and the background aside.
  static constexpr std::size_t kMaxWaiting = 64;           // of all clients
  static constexpr std::size_t kMaxWaitingPerClient = 16;  // of one
  // More than there are places for estimates: a new scene never waits for the end of a long one.
  static constexpr std::size_t kMaxBegun = 16;
  // A client that was served so lately may come back at any moment: promises count on it.
  static constexpr std::chrono::seconds kLately{2};

  // Throws Error(kExhausted) when too many wait.
  Id add(const JobTerms&, Time now);
  // The job whose turn it is with the device, begun or not. Empty when none may run.
  std::optional<Id> next(std::size_t device, Time now) const;
  // Whether `running` is to make way for another.
  bool makes_way(Id running, Time now) const;
  // Whether `id` has `what` alone now, until it ends or gives it back. False: another has it, and `id` needs
  // it.
  bool take(Id id, const void* what);
  void give_back(Id);
  // Whether another device's job has what it needs.
  bool waits_elsewhere(Id) const;
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
  struct Account {
    double served_s = 0;
    std::size_t jobs = 0, waiting = 0;  // owed ones aside
    Time lately;
  };
  struct Device {
    std::map<std::string, Account> accounts;
    std::size_t waiting = 0, begun = 0;  // owed ones aside
    double level_s = 0;                  // where a client that comes anew starts
    Id owed = 0;                         // that was begun
  };
  struct Job {
    JobTerms terms;
    bool begun = false;
    double left_s = 0;
    const void* needs = nullptr;
  };
  bool bounded(const Job& job) const { return !job.terms.owed && !job.terms.background; }
  bool due(const Job&, Time now) const;
  Id holder(Id, const Job&) const;
  bool may_run(Id, const Job&) const;
  std::optional<Id> first(std::size_t device, Time now) const;
  Account& account(const JobTerms&, Time now);
  const Account& account(const Job&) const;
  void charge(const Job&, double seconds);
  std::map<Id, Job> jobs_;
  std::map<std::size_t, Device> devices_;
  std::map<const void*, Id> held_;
  Id last_ = 0;
};

}  // namespace teletact::service
