// A service in the test's own process that speaks the contract without computing anything: it checks what
// clients send, answers what the test tells it to, and keeps what it saw.
#pragma once

#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "teletact/v1/elastography.grpc.pb.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::test {

// By which name the caller is known, "" when it gave none.
inline std::string named_in(const grpc::ServerContext& context) {
  const auto& metadata = context.client_metadata();
  const auto named = metadata.find("teletact-client");
  return named == metadata.end() ? "" : std::string(named->second.data(), named->second.size());
}

// What it shows to be let in, "" when nothing.
inline std::string authorization_in(const grpc::ServerContext& context) {
  const auto shown = context.client_metadata().find("authorization");
  return shown == context.client_metadata().end() ? ""
                                                  : std::string(shown->second.data(), shown->second.size());
}

class FakeElastography final : public v1::Elastography::Service {
 public:
  std::atomic<int> unavailable_calls{0};  // the next n calls fail so
  std::atomic<int> untracked_calls{0};    // the next n calls fail with FAILED_PRECONDITION
  std::atomic<int> compute_ms{0};

  struct Call {
    v1::Acquisition acquisition;
    std::string pre, post, client;
    std::size_t largest_chunk = 0;
  };
  std::vector<Call> calls() const {
    const std::lock_guard lock(mutex_);
    return calls_;
  }

  grpc::Status Estimate(
      grpc::ServerContext* context,
      grpc::ServerReaderWriter<v1::EstimateResponse, v1::EstimateRequest>* stream) override {
    if (unavailable_calls.fetch_sub(1) > 0) return {grpc::StatusCode::UNAVAILABLE, "draining"};
    unavailable_calls = 0;
    Call call;
    call.client = named_in(*context);
    v1::EstimateRequest request;
    while (stream->Read(&request)) {
      if (request.has_acquisition()) call.acquisition = request.acquisition();
      if (!request.has_chunk()) continue;
      const v1::FrameChunk& chunk = request.chunk();
      std::string& frame = chunk.frame() == v1::FRAME_KIND_PRE ? call.pre : call.post;
      if (chunk.offset_bytes() != frame.size())
        return {grpc::StatusCode::INVALID_ARGUMENT, "chunk.offset_bytes does not continue the frame"};
      call.largest_chunk = std::max(call.largest_chunk, chunk.data().size());
      frame += chunk.data();
    }
    if (untracked_calls.fetch_sub(1) > 0)
      return {grpc::StatusCode::FAILED_PRECONDITION, "could not be tracked"};
    untracked_calls = 0;
    std::this_thread::sleep_for(std::chrono::milliseconds(compute_ms));
    v1::EstimateResponse response;
    response.mutable_progress()->set_stage(v1::ESTIMATE_STAGE_RECEIVED);
    stream->Write(response);
    {
      const std::lock_guard lock(mutex_);
      calls_.push_back(call);
      v1::EstimateSummary& summary = *response.mutable_summary();
      summary.set_modulus_absolute(call.acquisition.has_probe_force());
      summary.set_scene_id(call.acquisition.publish().scene_id());
      const auto& origin_m = call.acquisition.publish().window().origin_m();
      const double window_x_m = origin_m.empty() ? 0 : origin_m.Get(0);
      summary.set_window_id(static_cast<std::uint64_t>(window_x_m / 0.06 + 0.5) + 1);
      summary.set_scene_version(calls_.size());
      summary.set_received_to_published_s(compute_ms * 1e-3);
    }
    for (const std::string& name : call.acquisition.maps()) send_map(*stream, name, call.pre[0]);
    stream->Write(response);
    return grpc::Status::OK;
  }

 private:
  // 2 x 2 nodes, 10 mm apart: a modulus of 10 kPa and one more for each of the frame's first sample, known to
  // 0.1.
  static void send_map(grpc::ServerReaderWriter<v1::EstimateResponse, v1::EstimateRequest>& stream,
                       const std::string& name, char frame) {
    v1::EstimateResponse response;
    v1::Map& map = *response.mutable_map()->mutable_map();
    map.set_name(name);
    for (int axis = 0; axis < 2; ++axis) {
      map.mutable_grid()->add_size(2);
      map.mutable_grid()->add_origin_m(0.005);
      map.mutable_grid()->add_spacing_m(0.01);
      map.mutable_values()->add_shape(2);
    }
    const float modulus = 1e4F + 1e3F * static_cast<float>(frame);
    const std::vector<float> values(4, name == "youngs_modulus" ? modulus : name == "valid" ? 1.0F : 0.1F);
    map.mutable_values()->set_dtype(v1::DATA_TYPE_FLOAT32);
    map.mutable_values()->set_data(values.data(), values.size() * sizeof(float));
    stream.Write(response);
  }

  mutable std::mutex mutex_;
  std::vector<Call> calls_;
};

class FakePalpation final : public v1::Palpation::Service {
 public:
  // What WatchFinger tells from now on.
  void set_finger(bool present, double x_m, double velocity_m_s, double z_m = 0, double velocity_z_m_s = 0) {
    const std::lock_guard lock(mutex_);
    finger_.mutable_stamp()->set_monotonic_ns(static_cast<std::int64_t>(++changes_));
    finger_.set_present(present);
    finger_.mutable_position_m()->Clear();
    finger_.add_position_m(x_m);
    finger_.add_position_m(0);
    finger_.add_position_m(z_m);
    finger_.mutable_velocity_m_s()->Clear();
    finger_.add_velocity_m_s(velocity_m_s);
    finger_.add_velocity_m_s(0);
    finger_.add_velocity_m_s(velocity_z_m_s);
    changed_.notify_all();
  }

  // The same of the slice that it asks for.
  void set_wish(double z_m, double half_width) {
    const std::lock_guard lock(mutex_);
    finger_.mutable_wish()->set_z_m(z_m);
    finger_.mutable_wish()->set_half_width(half_width);
    ++changes_;
    changed_.notify_all();
  }

  // The state once more, as a service does to show that it is there.
  void repeat_finger() {
    const std::lock_guard lock(mutex_);
    ++changes_;
    changed_.notify_all();
  }

  std::atomic<bool> keeps_out{false};                           // whoever asks for scenes, or for one
  std::atomic<int> starting_calls{0};                           // the next n of ListScenes fail so
  std::atomic<int> told{0};                                     // states of the finger so far
  std::atomic<int> watches{0};                                  // opened so far
  std::atomic<grpc::StatusCode> refusal{grpc::StatusCode::OK};  // ends one watch, once

  std::atomic<int> lost_scenes{0};  // the next n of CreateScene answer UNAVAILABLE, whatever they did
  grpc::Status CreateScene(grpc::ServerContext* context, const v1::CreateSceneRequest* request,
                           v1::Scene* scene) override {
    if (lost_scenes > 0 && lost_scenes-- > 0) {
      CreateScene(context, request, scene);
      return {grpc::StatusCode::UNAVAILABLE, "the link broke"};
    }
    const std::lock_guard lock(mutex_);
    const auto [it, fresh] = scenes_.try_emplace(request->scene_id());
    if (!fresh) return {grpc::StatusCode::ALREADY_EXISTS, "scene_id is taken"};
    it->second.set_scene_id(request->scene_id());
    *it->second.mutable_geometry() = request->geometry();
    for (const v1::ModulusSlice& slice : request->slices()) take(it->second, slice);
    *scene = it->second;
    return grpc::Status::OK;
  }

  std::atomic<int> unavailable_slices{0};   // the next n of PublishSlice fail so
  std::vector<std::string> slice_warnings;  // of every PublishSlice; set before any
  grpc::Status PublishSlice(grpc::ServerContext*, const v1::PublishSliceRequest* request,
                            v1::PublishSliceResponse* response) override {
    if (unavailable_slices > 0 && unavailable_slices-- > 0)
      return {grpc::StatusCode::UNAVAILABLE, "draining"};
    const std::lock_guard lock(mutex_);
    const auto it = scenes_.find(request->scene_id());
    if (it == scenes_.end()) return {grpc::StatusCode::NOT_FOUND, "scene is unknown"};
    take(it->second, request->slice());
    response->set_version(it->second.version());
    for (const std::string& warning : slice_warnings) response->add_warnings(warning);
    return grpc::Status::OK;
  }
  std::vector<v1::ModulusSlice> slices() {  // as they came, whatever their scene
    const std::lock_guard lock(mutex_);
    return slices_;
  }
  void forget_scenes() {
    const std::lock_guard lock(mutex_);
    scenes_.clear();
  }

  std::vector<std::string> clients() {  // of ListScenes and WatchFinger, a name for each call
    const std::lock_guard lock(mutex_);
    return clients_;
  }
  std::vector<std::string> shown() {  // what the same calls showed to be let in
    const std::lock_guard lock(mutex_);
    return shown_;
  }

  grpc::Status ListScenes(grpc::ServerContext* context, const v1::ListScenesRequest*,
                          v1::ListScenesResponse*) override {
    {
      const std::lock_guard lock(mutex_);
      clients_.push_back(named_in(*context));
      shown_.push_back(authorization_in(*context));
    }
    if (keeps_out) return {grpc::StatusCode::UNAUTHENTICATED, "who calls?"};
    if (starting_calls > 0 && starting_calls-- > 0) return {grpc::StatusCode::UNAVAILABLE, "starting"};
    return grpc::Status::OK;
  }

  grpc::Status GetScene(grpc::ServerContext*, const v1::GetSceneRequest* request, v1::Scene* scene) override {
    if (keeps_out) return {grpc::StatusCode::UNAUTHENTICATED, "who calls?"};
    const std::lock_guard lock(mutex_);
    const auto it = scenes_.find(request->scene_id());
    if (it == scenes_.end()) return {grpc::StatusCode::NOT_FOUND, "scene is unknown"};
    *scene = it->second;
    return grpc::Status::OK;
  }

  grpc::Status WatchFinger(
      grpc::ServerContext* context,
      grpc::ServerReaderWriter<v1::FingerState, v1::WatchFingerRequest>* stream) override {
    v1::WatchFingerRequest request;
    if (!stream->Read(&request)) return grpc::Status::CANCELLED;
    std::unique_lock lock(mutex_);
    clients_.push_back(named_in(*context));
    shown_.push_back(authorization_in(*context));
    if (!scenes_.count(request.scene_id())) return {grpc::StatusCode::NOT_FOUND, "scene is unknown"};
    ++watches;
    for (std::uint64_t seen = 0; !context->IsCancelled();) {
      if (refusal != grpc::StatusCode::OK) return {refusal.exchange(grpc::StatusCode::OK), "for now"};
      changed_.wait_for(lock, std::chrono::milliseconds(20), [&] { return changes_ != seen; });
      if (changes_ == seen) continue;
      seen = changes_;
      v1::FingerState state = finger_;
      state.set_state(seen);
      lock.unlock();
      if (!stream->Write(state)) return grpc::Status::OK;
      ++told;
      lock.lock();
    }
    return grpc::Status::OK;
  }

 private:
  void take(v1::Scene& scene, const v1::ModulusSlice& slice) {
    slices_.push_back(slice);
    scene.add_slices_z_m(slice.pose().origin_m(2));
    scene.set_version(scene.version() + 1);
  }

  std::mutex mutex_;
  std::vector<v1::ModulusSlice> slices_;
  std::condition_variable changed_;
  std::uint64_t changes_ = 1;  // a watcher hears of the first state at once
  v1::FingerState finger_;
  std::map<std::string, v1::Scene> scenes_;
  std::vector<std::string> clients_, shown_;
};

// Both on a socket of their own, for as long as this lives.
class FakeServer {
 public:
  FakeServer() {
    char folder[] = "/tmp/tt-fake-XXXXXX";
    if (mkdtemp(folder) == nullptr) throw std::runtime_error("mkdtemp failed");
    folder_ = folder;
    address_ = "unix:" + folder_ + "/s";
    grpc::ServerBuilder builder;
    builder.AddListeningPort(address_, grpc::InsecureServerCredentials());
    // A synchronous server's idle thread notices a shutdown only when its wait ends: 10 s by default.
    builder.SetSyncServerOption(grpc::ServerBuilder::CQ_TIMEOUT_MSEC, 100);
    builder.RegisterService(&elastography);
    builder.RegisterService(&palpation);
    server_ = builder.BuildAndStart();
    if (!server_) throw std::runtime_error("cannot listen on " + address_);
  }
  ~FakeServer() {
    server_->Shutdown(std::chrono::system_clock::now());
    unlink((folder_ + "/s").c_str());
    rmdir(folder_.c_str());
  }

  const std::string& address() const { return address_; }
  void create_scene(const std::string& id) {
    v1::CreateSceneRequest request;
    request.set_scene_id(id);
    v1::Scene scene;
    palpation.CreateScene(nullptr, &request, &scene);
  }

  FakeElastography elastography;
  FakePalpation palpation;

 private:
  std::string folder_, address_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace teletact::test
