#include <algorithm>
#include <chrono>
#include <utility>

#include "bench/basics/clock.h"
#include "bench/suites/soak/soak.h"
#include "client/acquire/estimate_client.h"
#include "client/clock/clock.h"
#include "client/link/channel.h"

namespace teletact::bench::soak {
namespace {

// A refusal that comes so soon after the last byte leaves the caller time to do something else.
constexpr double kAtOnceS = 0.5;
constexpr double kLongModulusS = 60;  // the contract's longest
constexpr int kGreedyCalls = 16;
constexpr auto kGreedyPause = std::chrono::milliseconds(50);
constexpr auto kLookEvery = std::chrono::milliseconds(10);

v1::Acquisition published(const client::FramePair& pair, const std::string& scene_id, double window_x_m) {
  v1::Acquisition acquisition = pair.acquisition;
  acquisition.mutable_publish()->set_scene_id(scene_id);
  for (const double origin_m : {window_x_m, 0.0})
    acquisition.mutable_publish()->mutable_window()->add_origin_m(origin_m);
  return acquisition;
}

double width_m(const v1::Acquisition& acquisition) {
  return acquisition.line_pitch_m() * acquisition.line_count();
}

double seconds_since_ns(std::int64_t then_ns) {
  return client::seconds(client::monotonic_ns() - then_ns);
}

// "DEADLINE_EXCEEDED" of "Estimate: DEADLINE_EXCEEDED: ..."
std::string code_in(const client::ServiceError& error) {
  const std::string named = client::describe(grpc::Status(error.code, ""));
  return named.substr(0, named.find(':'));
}

}  // namespace

FairImager::FairImager(const Service& service, std::string name, std::string scene_id,
                       const std::vector<client::FramePair>& pairs, double every_s, double finish_within_s,
                       const Pause& pause)
    : name_(std::move(name)),
      scene_id_(std::move(scene_id)),
      every_s_(every_s),
      finish_within_s_(finish_within_s),
      thread_([this, service, &pairs, &pause] { run(service, pairs, pause); }) {}

FairImager::~FairImager() {
  stop();
}

void FairImager::stop() {
  stop_ = true;
  if (thread_.joinable()) thread_.join();
}

void FairImager::run(const Service& service, const std::vector<client::FramePair>& pairs,
                     const Pause& pause) {
  client::EstimateClient estimator(client::make_channel(service.address, service.tls_ca, name_), 0);
  const auto every = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(every_s_));
  auto due = Clock::now();
  for (std::size_t k = 0; !stop_; ++k) {
    const client::FramePair& pair = pairs[k % pairs.size()];
    v1::Acquisition acquisition =
        published(pair, scene_id_, static_cast<double>(k % pairs.size()) * width_m(pair.acquisition));
    acquisition.set_finish_within_s(finish_within_s_);
    std::int64_t last_byte_ns = client::monotonic_ns();
    client::EstimateCallbacks callbacks;
    callbacks.request = [&](const v1::EstimateRequest&) { last_byte_ns = client::monotonic_ns(); };
    try {
      estimator.estimate(acquisition, pair.pre, pair.post, callbacks, stop_);
      const double took_s = seconds_since_ns(last_byte_ns);
      (took_s <= finish_within_s_ ? windows_.published_s : windows_.late_s).push_back(took_s);
      statuses_.add("OK");
    } catch (const client::ServiceError& error) {
      const double took_s = seconds_since_ns(last_byte_ns);
      (took_s <= kAtOnceS ? windows_.refused_s : windows_.late_s).push_back(took_s);
      statuses_.add(code_in(error));
    }
    due = std::max(due + every, Clock::now());
    while (!stop_ && (pause || Clock::now() < due)) std::this_thread::sleep_for(kLookEvery);
  }
}

std::unique_ptr<Rogue> start_greedy(const Service& service, const std::string& scene_id,
                                    const std::vector<client::FramePair>& pairs, const Pause& pause) {
  auto rogue = std::make_unique<Rogue>();
  const auto channel = client::make_channel(service.address, service.tls_ca, "soak-greedy");
  for (int k = 0; k < kGreedyCalls; ++k)
    rogue->threads.emplace_back([&rogue = *rogue, channel, scene_id, k, &pairs, &pause] {
      client::EstimateClient estimator(channel, 0);
      const client::FramePair& pair = pairs[static_cast<std::size_t>(k) % pairs.size()];
      v1::Acquisition acquisition = published(pair, scene_id, 0);
      acquisition.set_modulus_time_limit_s(kLongModulusS);
      for (bool wide = k % 2 == 0; !rogue.stop; wide = !wide) try {
          while (!rogue.stop && pause) std::this_thread::sleep_for(kLookEvery);
          acquisition.set_max_strain(wide ? 0.08 : 0.04);
          estimator.estimate(acquisition, pair.pre, pair.post, {}, rogue.stop);
          rogue.statuses.add("OK");
        } catch (const client::ServiceError& error) {
          rogue.statuses.add(code_in(error));
          std::this_thread::sleep_for(kGreedyPause);
        }
    });
  return rogue;
}

}  // namespace teletact::bench::soak
