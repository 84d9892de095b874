// An RF pair of speckle, a client that uploads it, and one that touches meanwhile.
#pragma once

#include <algorithm>
#include <atomic>
#include <future>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/imaging/speckle.h"
#include "tests/rpc/running_server.h"

namespace teletact::service {

constexpr std::size_t kSamples = 1039, kLines = 85;  // 20 x 20 mm
constexpr double kStrain = -0.012;

struct Pair {
  std::string pre, post;
};

inline const Pair& pair() {
  static const Pair made = [] {
    SpeckleOptions options;
    options.samples = kSamples, options.lines = kLines, options.snr_db = 30, options.correlation = 0.99;
    const Speckle speckle(options);
    const auto bytes = [](const RfFrame& frame) {
      return std::string(reinterpret_cast<const char*>(frame.samples.data()),
                         frame.samples.size() * sizeof(float));
    };
    return Pair{bytes(speckle.frame(
                    [](double, double) {
                      return std::pair{0.0, 0.0};
                    },
                    1)),
                bytes(speckle.frame(
                    [](double, double y) {
                      return std::pair{0.0, kStrain * y};
                    },
                    2))};
  }();
  return made;
}

inline v1::Acquisition acquisition(const std::string& scene = "", double window_x_m = 0) {
  const AcquisitionGeometry g = speckle_geometry();
  v1::Acquisition a;
  a.set_sample_count(kSamples), a.set_line_count(kLines);
  a.set_dtype(v1::DATA_TYPE_FLOAT32);
  a.set_center_frequency_hz(g.center_frequency_hz), a.set_sampling_frequency_hz(g.sampling_frequency_hz);
  a.set_sound_speed_m_s(1540), a.set_line_pitch_m(g.line_pitch_m);
  a.set_displacement_frame(v1::DISPLACEMENT_FRAME_PROBE);
  a.mutable_probe_force()->set_force_n(2.0);
  a.mutable_probe_force()->set_contact_area_m2(kLines * g.line_pitch_m * 0.010);
  if (!scene.empty()) {
    a.mutable_publish()->set_scene_id(scene);
    for (const double origin_m : {window_x_m, 0.0})
      a.mutable_publish()->mutable_window()->add_origin_m(origin_m);
  }
  return a;
}

struct Outcome {
  grpc::Status status;
  std::vector<v1::EstimateStage> stages;
  std::vector<v1::Map> maps;
  v1::EstimateSummary summary;
};

class Elastographer {
 public:
  explicit Elastographer(const std::shared_ptr<grpc::Channel>& channel, const std::string& client = "")
      : stub_(v1::Elastography::NewStub(channel)) {
    set_deadline(context_);
    if (!client.empty()) context_.AddMetadata("teletact-client", client);
    stream_ = stub_->Estimate(&context_);
  }
  void send(const v1::Acquisition& a) {
    v1::EstimateRequest request;
    *request.mutable_acquisition() = a;
    stream_->Write(request);
  }
  bool send(v1::FrameKind kind, std::uint64_t offset, const std::string& data) {
    v1::EstimateRequest request;
    request.mutable_chunk()->set_frame(kind);
    request.mutable_chunk()->set_offset_bytes(offset);
    request.mutable_chunk()->set_data(data);
    return stream_->Write(request);
  }
  void send_frame(v1::FrameKind kind, const std::string& frame) {
    constexpr std::size_t kChunk = 100'000;
    for (std::size_t at = 0; at < frame.size(); at += kChunk)
      if (!send(kind, at, frame.substr(at, kChunk))) return;
  }
  void close() {
    if (!std::exchange(closed_, true)) stream_->WritesDone();
  }
  bool read(v1::EstimateResponse* response) { return stream_->Read(response); }
  Outcome finish() {
    Outcome outcome;
    close();
    v1::EstimateResponse response;
    while (stream_->Read(&response)) {
      if (response.has_progress()) outcome.stages.push_back(response.progress().stage());
      if (response.has_map()) outcome.maps.push_back(response.map().map());
      if (response.has_summary()) outcome.summary = response.summary();
    }
    outcome.status = stream_->Finish();
    return outcome;
  }
  grpc::ClientContext& context() { return context_; }

 private:
  std::unique_ptr<v1::Elastography::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::EstimateRequest, v1::EstimateResponse>> stream_;
  bool closed_ = false;
};

inline void upload(Elastographer& call, const v1::Acquisition& a, const Pair& frames = pair()) {
  call.send(a);
  call.send_frame(v1::FRAME_KIND_PRE, frames.pre);
  call.send_frame(v1::FRAME_KIND_POST, frames.post);
  call.close();
}

inline Outcome estimate(const std::shared_ptr<grpc::Channel>& channel, const v1::Acquisition& a,
                        const Pair& frames = pair(), const std::string& client = "") {
  Elastographer call(channel, client);
  upload(call, a, frames);
  return call.finish();
}

// Touches all the time from a connection of its own, and keeps what it met.
class Bystander {
 public:
  // Returns once it is served, or has failed: on a busy machine a test may be over before a thread begins.
  Bystander(const std::shared_ptr<grpc::Channel>& channel, const std::string& scene,
            double period_s = 0.004) {
    thread_ = std::thread([this, channel, scene, period_s] {
      v1::TouchOpen open = Toucher::open_on(scene);
      open.set_period_s(period_s);
      Toucher toucher(channel, open);
      if (!toucher.opened()) ++failures_;
      v1::TouchAnswer answer;
      for (int k = 0; !stop_; ++k) {
        const auto begun = std::chrono::steady_clock::now();
        if (!toucher.touch(0.05 + 1e-5 * (k % 100), 0.003, &answer) ||
            answer.status() != v1::TOUCH_STATUS_OK) {
          ++failures_;
          break;
        }
        const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begun;
        latency_s_.push_back(took.count());
        if (k == 0) served_.set_value();
      }
      if (latency_s_.empty()) served_.set_value();
      if (!toucher.finish().ok()) ++failures_;
    });
    served_.get_future().wait();
  }
  ~Bystander() { stop(); }
  void stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
  }
  int failures() const { return failures_; }
  // After stop().
  double latency_s(double quantile) {
    std::sort(latency_s_.begin(), latency_s_.end());
    return latency_s_.at(static_cast<std::size_t>(quantile * static_cast<double>(latency_s_.size() - 1)));
  }
  std::size_t answers() const { return latency_s_.size(); }

 private:
  std::atomic<bool> stop_{false};
  std::atomic<int> failures_{0};
  std::vector<double> latency_s_;
  std::promise<void> served_;
  std::thread thread_;
};

}  // namespace teletact::service
