#include "service/scene/schedule.h"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>
#include <utility>

#include "service/scene/errors.h"

namespace teletact::service {

namespace {

double seconds(Schedule::Time::duration d) {
  return std::chrono::duration<double>(d).count();
}

}  // namespace

Schedule::Account& Schedule::account(const JobTerms& terms, Time now) {
  Device& device = devices_[terms.device];
  Account& a = device.accounts[terms.client];
  if (a.jobs == 0) a.served_s = std::max(a.served_s, device.level_s);
  a.lately = now;
  return a;
}

Schedule::Id Schedule::add(const JobTerms& terms, Time now) {
  const Job job{terms, false, terms.cost_s, nullptr};
  Device& device = devices_[terms.device];
  if (bounded(job)) {
    const auto refuse = [&](std::size_t waiting, const char* of) {
      throw Error(ErrorKind::kExhausted, fmt::format("{} jobs{} wait already, no more are taken; it could be "
                                                     "done in {:.1f} s, try again then",
                                                     waiting, of, done_in_s(terms, now)));
    };
    const auto mine = device.accounts.find(terms.client);
    if (mine != device.accounts.end() && mine->second.waiting >= kMaxWaitingPerClient)
      refuse(mine->second.waiting, " of this client");
    if (device.waiting >= kMaxWaiting) refuse(device.waiting, "");
    ++account(terms, now).waiting, ++device.waiting;
  }
  if (!terms.owed) ++account(terms, now).jobs;
  jobs_[++last_] = job;
  return last_;
}

// Owed ones are so when what is left of them would just be done in time.
bool Schedule::due(const Job& job, Time now) const {
  return job.terms.owed && job.terms.deadline != Time::max() &&
         seconds(job.terms.deadline - now) <= job.left_s + kSliceS;
}

// Another job that has what this one needs; 0: none.
Schedule::Id Schedule::holder(Id id, const Job& job) const {
  const auto held = held_.find(job.needs);
  return held == held_.end() || held->second == id ? 0 : held->second;
}

bool Schedule::waits_elsewhere(Id id) const {
  const Job& job = jobs_.at(id);
  const Id other = holder(id, job);
  return other && jobs_.at(other).terms.device != job.terms.device;
}

bool Schedule::may_run(Id id, const Job& job) const {
  const Device& device = devices_.at(job.terms.device);
  if (waits_elsewhere(id)) return false;
  if (job.terms.owed) return device.owed == 0 || device.owed == id || waits_elsewhere(device.owed);
  return job.begun || job.terms.background || device.begun < kMaxBegun;
}

// Whose turn it is, though another may have to use it.
std::optional<Schedule::Id> Schedule::first(std::size_t device, Time now) const {
  enum Class { kDue, kAskedFor, kOwed };
  const auto order = [&](Id id, const Job& job) {
    const Class of = !job.terms.owed ? kAskedFor : due(job, now) ? kDue : kOwed;
    const double served_s = of == kAskedFor ? account(job).served_s : 0;
    return std::tuple(of, served_s, !job.begun, job.terms.deadline, id);
  };
  std::optional<decltype(order(0, Job()))> best;
  for (const auto& [id, job] : jobs_) {
    if (job.terms.device != device || !may_run(id, job)) continue;
    const auto its = order(id, job);
    if (!best || its < *best) best = its;
  }
  return best ? std::optional(std::get<Id>(*best)) : std::nullopt;
}

std::optional<Schedule::Id> Schedule::next(std::size_t device, Time now) const {
  const auto turn = first(device, now);
  if (!turn) return turn;
  const Id other = holder(*turn, jobs_.at(*turn));
  return other ? other : *turn;
}

bool Schedule::makes_way(Id running, Time now) const {
  const Job& job = jobs_.at(running);
  const auto turn = first(job.terms.device, now);
  if (!turn || *turn == running || job.terms.background || due(job, now)) return false;
  const Job& other = jobs_.at(*turn);
  if (holder(*turn, other) == running) return false;
  if (other.terms.owed || job.terms.owed) return true;
  return account(other).served_s + kSliceS <= account(job).served_s;
}

const Schedule::Account& Schedule::account(const Job& job) const {
  return devices_.at(job.terms.device).accounts.at(job.terms.client);
}

bool Schedule::take(Id id, const void* what) {
  jobs_.at(id).needs = what;
  return held_.try_emplace(what, id).first->second == id;
}

void Schedule::give_back(Id id) {
  const void* what = std::exchange(jobs_.at(id).needs, nullptr);
  if (const auto held = held_.find(what); held != held_.end() && held->second == id) held_.erase(held);
}

void Schedule::begun(Id id) {
  Job& job = jobs_.at(id);
  Device& device = devices_.at(job.terms.device);
  if (std::exchange(job.begun, true)) return;
  if (job.terms.owed) device.owed = id;
  if (job.terms.background) charge(job, kSliceS);
  if (bounded(job)) ++device.begun, --device.waiting, --device.accounts.at(job.terms.client).waiting;
}

void Schedule::served(Id id, double seconds, Time now) {
  Job& job = jobs_.at(id);
  job.left_s = std::max(0.0, job.left_s - seconds);
  account(job.terms, now);  // of what is owed, it may be new
  if (!job.terms.background) charge(job, seconds);
}

void Schedule::charge(const Job& job, double seconds) {
  Device& device = devices_.at(job.terms.device);
  double& served_s = device.accounts.at(job.terms.client).served_s;
  if (!job.terms.owed) device.level_s = std::max(device.level_s, served_s);
  served_s += seconds;
}

void Schedule::ended(Id id, Time now) {
  give_back(id);
  const Job& job = jobs_.at(id);
  Device& device = devices_.at(job.terms.device);
  if (device.owed == id) device.owed = 0;
  if (!job.terms.owed) {
    Account& a = device.accounts.at(job.terms.client);
    --a.jobs;
    a.lately = now;
    if (bounded(job) && job.begun) --device.begun;
    if (bounded(job) && !job.begun) --a.waiting, --device.waiting;
  }
  jobs_.erase(id);
  std::erase_if(device.accounts, [&](const auto& entry) {
    return entry.second.jobs == 0 && entry.second.lately + kLately < now;
  });
}

std::vector<Schedule::Id> Schedule::expired(Time now) const {
  std::vector<Id> out;
  for (const auto& [id, job] : jobs_)
    if (!job.terms.owed && !job.begun && job.terms.deadline <= now) out.push_back(id);
  return out;
}

double Schedule::done_in_s(const JobTerms& terms, Time now) const {
  double own_s = terms.cost_s, owed_s = 0;
  for (const auto& [id, job] : jobs_) {
    if (job.terms.device != terms.device) continue;
    const double left_s = std::max(job.left_s, job.begun ? kSliceS : 0);  // one that is late, too
    if (job.terms.owed)
      owed_s += left_s;
    else if (job.terms.client == terms.client && (job.begun || job.terms.deadline <= terms.deadline))
      own_s += left_s;
  }
  std::ptrdiff_t others = 0;
  if (const auto device = devices_.find(terms.device); device != devices_.end())
    others =
        std::count_if(device->second.accounts.begin(), device->second.accounts.end(), [&](const auto& entry) {
          return entry.first != terms.client &&
                 (entry.second.jobs > 0 || entry.second.lately + kLately >= now);
        });
  return own_s * static_cast<double>(1 + others) + owed_s;
}

}  // namespace teletact::service
