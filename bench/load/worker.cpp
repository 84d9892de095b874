#include "bench/load/worker.h"

#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <queue>
#include <thread>
#include <vector>

#include "bench/load/recorded_finger.h"
#include "bench/load/session.h"
#include "bench/load/sweep.h"
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
  // `recorded`: what its finger does; none: it sweeps.
  Place(const LoadPlan& plan, std::shared_ptr<const RecordedTouch> recorded, unsigned client,
        Clock::time_point begin)
      : plan_(plan), client_(client), begin_(begin), random_(plan.seed * 7919 + client) {
    if (recorded)
      do_again(std::move(recorded));
    else
      sweep();
    if (plan.closed_loop) next_ = [] { return kForever; };
    finger_.open.set_scene_id(plan.scene_ids.at(client % plan.scene_ids.size()));
    if (plan.laws) finger_.open.set_laws(true);
    finger_.in_flight = plan.in_flight, finger_.closed_loop = plan.closed_loop;
    finger_.greedy = plan.greedy;
    finger_.counted_from_s = plan.warm_up_s, finger_.until_s = plan.warm_up_s + plan.duration_s;
    open(0);
    next_due_s_ = next_();
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
    next_due_s_ = next_();
  }
  void end() { session_->end(LoadSession::End::kServed); }
  void finish(Clock::time_point limit, Tally& tally) {
    gone_.push_back(std::move(session_));
    for (const auto& session : gone_) tally.add(session->finish(limit));
  }

 private:
  void do_again(std::shared_ptr<const RecordedTouch> recorded) {
    finger_.open = recorded->open;
    const auto finger = std::make_shared<RecordedFinger>(std::move(recorded), client_);
    next_ = [finger] { return finger->next(); };
    finger_.pose = [finger](double time_s, v1::ContactPose& to) {
      const RecordedTouch::Pose& pose = finger->at(time_s);
      for (const double x : pose.position_m) to.add_position_m(x);
      for (const double v : pose.velocity_m_s) to.add_velocity_m_s(v);
    };
  }
  void sweep() {
    if (!plan_.closed_loop)
      next_ = [arrivals = Arrivals(
                   {plan_.rate_hz, plan_.end_rate_hz, plan_.warm_up_s + plan_.duration_s, plan_.poisson},
                   client_, plan_.seed)]() mutable { return arrivals.next(); };
    finger_.pose = [this](double time_s, v1::ContactPose& to) {
      const double x_m = sweep_m(plan_.begin_m, plan_.end_m, plan_.speed_m_s, client_, time_s);
      for (const double coordinate : {x_m, plan_.indentation_m, 0.0}) to.add_position_m(coordinate);
      for (int axis = 0; axis < 3; ++axis) to.add_velocity_m_s(0);
    };
  }
  void open(double now_s) {
    finger_.open.set_session_id(fmt::format("load-{}-{}", client_, streams_++));
    session_ = std::make_unique<LoadSession>(client::make_channel(plan_.address, plan_.credentials), finger_,
                                             begin_);
    leaves_s_ = plan_.stay_s > 0 ? now_s + std::exponential_distribution<double>(1 / plan_.stay_s)(random_)
                                 : kForever;
  }

  const LoadPlan& plan_;
  unsigned client_, streams_ = 0;
  Clock::time_point begin_;
  std::function<double()> next_;  // instant of a pose
  FingerPlan finger_;             // of each stream
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
  const auto recorded = plan.recording.empty() ? nullptr : read_recorded_touch(plan.recording);
  Tally tally;
  std::vector<std::unique_ptr<Place>> places;
  using Next = std::pair<double, std::size_t>;
  std::priority_queue<Next, std::vector<Next>, std::greater<>> next;
  for (unsigned k = 0; k < plan.clients; ++k) {
    places.push_back(std::make_unique<Place>(plan, recorded, plan.first_client + k, begin));
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
