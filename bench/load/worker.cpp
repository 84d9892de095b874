#include "bench/load/worker.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <queue>
#include <thread>
#include <vector>

#include "bench/load/session.h"
#include "client/link/channel.h"

namespace teletact::bench {
namespace {

using Clock = LoadSession::Clock;

constexpr double kForever = std::numeric_limits<double>::infinity();
constexpr double kLastAnswersS = 0.25;  // are waited for
constexpr double kEndsS = 3;            // after which a stream that does not end is cut

// A client's place: one stream after the other.
class Place {
 public:
  Place(const LoadPlan& plan, unsigned client, Clock::time_point begin)
      : plan_(plan), client_(client), begin_(begin), random_(plan.seed * 7919 + client) {
    if (!plan.closed_loop)
      arrivals_.emplace(Rate{plan.rate_hz, plan.end_rate_hz, plan.warm_up_s + plan.duration_s, plan.poisson},
                        client, plan.seed);
    open(0);
    schedule();
  }
  double next_s() const { return std::min(next_due_s_, leaves_s_); }
  void act(Tally& tally) {
    if (leaves_s_ <= next_due_s_) {
      const double now_s = leaves_s_;
      const bool drops = std::uniform_real_distribution<double>()(random_) < plan_.cancel_share;
      session_->end(drops ? LoadSession::End::kDropped : LoadSession::End::kLeft);
      gone_.push_back(std::move(session_));
      while (!gone_.empty() && gone_.front()->ended()) {
        tally.add(gone_.front()->finish(Clock::now()));
        gone_.pop_front();
      }
      open(now_s);
      return;
    }
    session_->due(next_due_s_);
    schedule();
  }
  void end() { session_->end(LoadSession::End::kServed); }
  void finish(Clock::time_point limit, Tally& tally) {
    gone_.push_back(std::move(session_));
    for (const auto& session : gone_) tally.add(session->finish(limit));
  }

 private:
  void schedule() { next_due_s_ = arrivals_ ? arrivals_->next() : kForever; }
  void open(double now_s) {
    FingerPlan finger{.scene_id = plan_.scene_id,
                      .session_id = fmt::format("load-{}-{}", client_, streams_++),
                      .begin_m = plan_.begin_m,
                      .end_m = plan_.end_m,
                      .indentation_m = plan_.indentation_m,
                      .speed_m_s = plan_.speed_m_s,
                      .client = client_,
                      .in_flight = plan_.in_flight,
                      .laws = plan_.laws,
                      .closed_loop = plan_.closed_loop,
                      .counted_from_s = plan_.warm_up_s,
                      .until_s = plan_.warm_up_s + plan_.duration_s};
    session_ = std::make_unique<LoadSession>(client::make_channel(plan_.address, plan_.tls_ca),
                                             std::move(finger), begin_);
    leaves_s_ = plan_.stay_s > 0 ? now_s + std::exponential_distribution<double>(1 / plan_.stay_s)(random_)
                                 : kForever;
  }

  const LoadPlan& plan_;
  unsigned client_, streams_ = 0;
  Clock::time_point begin_;
  std::optional<Arrivals> arrivals_;  // none: closed loop
  std::mt19937_64 random_;
  std::unique_ptr<LoadSession> session_;
  std::deque<std::unique_ptr<LoadSession>> gone_;
  double next_due_s_ = kForever, leaves_s_ = kForever;
};

}  // namespace

Tally run_worker(const LoadPlan& plan) {
  const Clock::time_point begin{std::chrono::nanoseconds(plan.begin_ns)};
  const auto at = [&](double time_s) {
    return begin + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(time_s));
  };
  Tally tally;
  std::vector<std::unique_ptr<Place>> places;
  using Next = std::pair<double, std::size_t>;
  std::priority_queue<Next, std::vector<Next>, std::greater<>> next;
  for (unsigned k = 0; k < plan.clients; ++k) {
    places.push_back(std::make_unique<Place>(plan, plan.first_client + k, begin));
    next.emplace(places.back()->next_s(), k);
  }
  const double last_s = plan.warm_up_s + plan.duration_s;
  while (!next.empty() && next.top().first < last_s) {
    const auto [time_s, k] = next.top();
    next.pop();
    std::this_thread::sleep_until(at(time_s));
    places[k]->act(tally);
    next.emplace(places[k]->next_s(), k);
  }
  std::this_thread::sleep_until(at(last_s + kLastAnswersS));
  for (const auto& place : places) place->end();
  const auto limit = Clock::now() + std::chrono::milliseconds(static_cast<std::int64_t>(1e3 * kEndsS));
  for (const auto& place : places) place->finish(limit, tally);
  return tally;
}

}  // namespace teletact::bench
