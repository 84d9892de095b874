#include "service/imaging_plane/fair_queue.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "service/scene/errors.h"

namespace teletact::service {

namespace {

double seconds(FairQueue::Time::duration d) {
  return std::chrono::duration<double>(d).count();
}

}  // namespace

FairQueue::Account& FairQueue::account(const std::string& client, Time now) {
  Account& a = accounts_[client];
  if (a.jobs == 0) a.served_s = std::max(a.served_s, level_s_);
  a.lately = now;
  return a;
}

FairQueue::Id FairQueue::add(const JobTerms& terms, Time now) {
  if (!terms.owed) {
    const auto mine = accounts_.find(terms.client);
    if (mine != accounts_.end() && mine->second.waiting >= kMaxWaitingPerClient)
      throw Error(ErrorKind::kExhausted,
                  fmt::format("{} jobs of this client wait already, no more are taken; it could be done in "
                              "{:.1f} s, try again then",
                              mine->second.waiting, done_in_s(terms, now)));
    if (waiting_ >= kMaxWaiting)
      throw Error(ErrorKind::kExhausted, fmt::format("{} jobs wait already, no more are taken; it could be "
                                                     "done in {:.1f} s, try again then",
                                                     waiting_, done_in_s(terms, now)));
    Account& a = account(terms.client, now);
    ++a.jobs, ++a.waiting, ++waiting_;
  }
  jobs_[++last_] = {terms, false, terms.cost_s, 0};
  return last_;
}

// Owed ones are so when what is left of them would just be done in time.
bool FairQueue::due(const Job& job, Time now) const {
  return job.terms.owed && job.terms.deadline != Time::max() &&
         seconds(job.terms.deadline - now) <= job.left_s + kSliceS;
}

// One at a time: what was begun is finished.
std::optional<FairQueue::Id> FairQueue::next_owed(Time now, bool due_only) const {
  std::optional<Id> first;
  for (const auto& [id, job] : jobs_) {
    if (!job.terms.owed) continue;
    if (job.begun) return !due_only || due(job, now) ? std::optional(id) : std::nullopt;
    if (due_only && !due(job, now)) continue;
    if (!first || job.terms.deadline < jobs_.at(*first).terms.deadline) first = id;
  }
  return first;
}

// What the client has begun, else the earliest deadline, else what came first.
std::optional<FairQueue::Id> FairQueue::next_of(const std::string& client) const {
  std::optional<Id> first;
  for (const auto& [id, job] : jobs_) {
    if (job.terms.owed || job.terms.client != client) continue;
    if (job.begun) return id;
    if (!first || job.terms.deadline < jobs_.at(*first).terms.deadline) first = id;
  }
  return first && begun_ < kMaxBegun ? first : std::nullopt;
}

// Whose turn it is, though another may have to use it.
std::optional<FairQueue::Id> FairQueue::first(Time now) const {
  if (const auto owed = next_owed(now, true)) return owed;
  std::optional<Id> best;
  double min_s = 0;
  for (const auto& [client, account] : accounts_) {
    if (account.jobs == 0 || (best && account.served_s >= min_s)) continue;
    if (const auto id = next_of(client)) best = id, min_s = account.served_s;
  }
  return best ? best : next_owed(now, false);
}

FairQueue::Id FairQueue::who_acts_for(Id id) const {
  for (auto other = jobs_.find(jobs_.at(id).waits_for); other != jobs_.end();
       other = jobs_.find(other->second.waits_for))
    id = other->first;
  return id;
}

std::optional<FairQueue::Id> FairQueue::next(Time now) const {
  const auto turn = first(now);
  return turn ? std::optional(who_acts_for(*turn)) : std::nullopt;
}

void FairQueue::wait(Id id, Id other) {
  jobs_.at(id).waits_for = other;
}

bool FairQueue::makes_way(Id running, Time now) const {
  const Job& job = jobs_.at(running);
  const auto turn = first(now);
  if (!turn || who_acts_for(*turn) == running || due(job, now)) return false;
  const Job& other = jobs_.at(*turn);
  if (other.terms.owed || job.terms.owed) return true;
  return accounts_.at(other.terms.client).served_s + kSliceS <= accounts_.at(job.terms.client).served_s;
}

void FairQueue::begun(Id id) {
  Job& job = jobs_.at(id);
  if (std::exchange(job.begun, true) || job.terms.owed) return;
  ++begun_, --waiting_, --accounts_.at(job.terms.client).waiting;
}

void FairQueue::served(Id id, double seconds, Time now) {
  Job& job = jobs_.at(id);
  job.left_s = std::max(0.0, job.left_s - seconds);
  Account& a = account(job.terms.client, now);
  if (!job.terms.owed) level_s_ = std::max(level_s_, a.served_s);
  a.served_s += seconds;
}

void FairQueue::ended(Id id, Time now) {
  const Job& job = jobs_.at(id);
  if (!job.terms.owed) {
    Account& a = accounts_.at(job.terms.client);
    --a.jobs;
    a.lately = now;
    if (job.begun)
      --begun_;
    else
      --a.waiting, --waiting_;
  }
  jobs_.erase(id);
  forget_the_gone(now);
}

void FairQueue::forget_the_gone(Time now) {
  std::erase_if(accounts_, [&](const auto& entry) {
    const Account& a = entry.second;
    return a.jobs == 0 && a.lately + kLately < now;
  });
}

std::vector<FairQueue::Id> FairQueue::expired(Time now) const {
  std::vector<Id> out;
  for (const auto& [id, job] : jobs_)
    if (!job.terms.owed && !job.begun && job.terms.deadline <= now) out.push_back(id);
  return out;
}

double FairQueue::done_in_s(const JobTerms& terms, Time now) const {
  double own_s = terms.cost_s, owed_s = 0;
  for (const auto& [id, job] : jobs_) {
    if (job.terms.owed)
      owed_s += job.left_s;
    else if (job.terms.client == terms.client && (job.begun || job.terms.deadline <= terms.deadline))
      own_s += job.left_s;
  }
  const auto others = std::count_if(accounts_.begin(), accounts_.end(), [&](const auto& entry) {
    return entry.first != terms.client && (entry.second.jobs > 0 || entry.second.lately + kLately >= now);
  });
  return own_s * static_cast<double>(1 + others) + owed_s;
}

}  // namespace teletact::service
