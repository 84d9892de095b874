#include "bench/imager.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "bench/basics/clock.h"
#include "bench/own_scene.h"
#include "client/acquire/simulated_source.h"
#include "client/clock/clock.h"
#include "client/link/channel.h"

namespace teletact::bench {
namespace {

// A refusal that comes so soon after the last byte leaves the caller time to do something else.
constexpr double kAtOnceS = 0.5;
constexpr auto kLookEvery = std::chrono::milliseconds(10);

double width_m(const v1::Acquisition& acquisition) {
  return acquisition.line_pitch_m() * acquisition.line_count();
}

double seconds_since_ns(std::int64_t then_ns) {
  return client::seconds(client::monotonic_ns() - then_ns);
}

}  // namespace

client::Tissue imaged_tissue() {
  client::Tissue tissue;
  tissue.width_m = 0.12;
  tissue.probe.width_m = 0.03;
  tissue.probe.lines = 128;
  tissue.inclusions.push_back({0.05, 0.012, 0.012, 4});
  return tissue;
}

std::vector<client::FramePair> imaged_pairs(const client::Tissue& tissue) {
  const client::Patient patient(tissue);
  client::SimulatedSource source(patient, 1, {});
  std::vector<client::FramePair> pairs;
  for (std::size_t k = 0; k < source.window_count(); ++k) pairs.push_back(source.take(k));
  return pairs;
}

void create_imaged_scene(v1::Palpation::Stub& stub, const std::string& id, const client::Tissue& tissue) {
  v1::CreateSceneRequest request;
  request.set_scene_id(id);
  request.mutable_geometry()->add_size_m(tissue.width_m);
  request.mutable_geometry()->add_size_m(tissue.depth_m);
  request.mutable_geometry()->set_poisson_ratio(tissue.poisson_ratio);
  create_scene(stub, request);
}

v1::Acquisition published(const client::FramePair& pair, const std::string& scene_id, double window_x_m) {
  v1::Acquisition acquisition = pair.acquisition;
  acquisition.mutable_publish()->set_scene_id(scene_id);
  for (const double origin_m : {window_x_m, 0.0})
    acquisition.mutable_publish()->mutable_window()->add_origin_m(origin_m);
  return acquisition;
}

std::string code_in(const client::ServiceError& error) {
  const std::string named = client::describe(grpc::Status(error.code, ""));
  return named.substr(0, named.find(':'));
}

std::string text_of(const Ends& ends) {
  std::string text;
  for (const auto& [code, count] : ends) text += fmt::format(" {} {}", code, count);
  return text;
}

std::string line_of(const WindowFigures& w) {
  return fmt::format("{}: {} windows in time, {} refused at once, {} late; ends:{}", w.name, w.published,
                     w.refused, w.late, text_of(w.ends));
}

Imager::Imager(const Service& service, std::string name, std::string scene_id,
               const std::vector<client::FramePair>& pairs, double every_s, double finish_within_s,
               const Pause& pause)
    : name_(std::move(name)),
      scene_id_(std::move(scene_id)),
      every_s_(every_s),
      finish_within_s_(finish_within_s),
      thread_([this, service, &pairs, &pause] { run(service, pairs, pause); }) {}

Imager::~Imager() {
  stop();
}

void Imager::stop() {
  stop_ = true;
  if (thread_.joinable()) thread_.join();
}

void Imager::run(const Service& service, const std::vector<client::FramePair>& pairs, const Pause& pause) {
  client::EstimateClient estimator(client::make_channel(service.address, service.credentials, name_), 0);
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
      (took_s <= finish_within_s_ ? published_s_ : late_s_).push_back(took_s);
      statuses_.add("OK");
    } catch (const client::ServiceError& error) {
      const double took_s = seconds_since_ns(last_byte_ns);
      const bool refused = error.code == grpc::StatusCode::RESOURCE_EXHAUSTED && took_s <= kAtOnceS;
      (refused ? refused_s_ : late_s_).push_back(took_s);
      statuses_.add(code_in(error));
    }
    due = std::max(due + every, Clock::now());
    while (!stop_ && (pause || Clock::now() < due)) std::this_thread::sleep_for(kLookEvery);
  }
}

WindowFigures Imager::windows() const {
  const auto of = [](const std::vector<double>& s) { return s.empty() ? Quantiles{} : quantiles(s); };
  return {name_,   published_s_.size(), refused_s_.size(), late_s_.size(), of(published_s_), of(refused_s_),
          late_s_, statuses_.counts()};
}

}  // namespace teletact::bench
