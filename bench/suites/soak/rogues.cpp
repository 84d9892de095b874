#include <grpcpp/grpcpp.h>

#include <chrono>
#include <utility>

#include "bench/suites/soak/soak.h"
#include "client/link/channel.h"
#include "teletact/v1/elastography.grpc.pb.h"
#include "teletact/v1/palpation.grpc.pb.h"
#include "tests/support/resettable_connection.h"

namespace teletact::bench::soak {
namespace {

constexpr auto kPoseEvery = std::chrono::milliseconds(10);
constexpr auto kUnreadFor = std::chrono::seconds(15);  // then it begins anew
constexpr auto kLifetime = std::chrono::seconds(1);
constexpr auto kCutAfter = std::chrono::seconds(60);  // a call that neither side ends
constexpr std::size_t kChunkBytes = 1 << 16;

std::string code_of(const grpc::Status& status) {
  const std::string named = client::describe(status);
  return named.substr(0, named.find(':'));
}

// A touch, a watch and an upload on one channel, none of which is ever read.
class UnreadCalls {
 public:
  UnreadCalls(const std::shared_ptr<grpc::Channel>& channel, const std::string& name,
              const std::string& scene_id, const client::FramePair& pair, double share_of_upload)
      : palpation_(v1::Palpation::NewStub(channel)), elastography_(v1::Elastography::NewStub(channel)) {
    for (grpc::ClientContext& context : contexts_) {
      if (!name.empty()) context.AddMetadata("teletact-client", name);
      context.set_deadline(std::chrono::system_clock::now() + kCutAfter);
    }
    touch_ = palpation_->Touch(&contexts_[0]);
    v1::TouchRequest open;
    open.mutable_open()->set_scene_id(scene_id);
    open.mutable_open()->set_period_s(0.002);
    touch_->Write(open);
    watch_ = palpation_->WatchFinger(&contexts_[1]);
    v1::WatchFingerRequest watched;
    watched.set_scene_id(scene_id);
    watch_->Write(watched);
    upload(pair, share_of_upload);
  }
  // False when the service has ended the stream.
  bool pose() {
    v1::TouchRequest request;
    v1::ContactPose& pose = *request.mutable_pose();
    pose.set_sequence(++sequence_);
    for (const double coordinate : {0.05, 0.002}) pose.add_position_m(coordinate);
    return touch_->Write(request);
  }
  void cancel() {
    for (grpc::ClientContext& context : contexts_) context.TryCancel();
  }
  // After cancel(), or when the connection is gone.
  void finish(Statuses& statuses) {
    statuses.add("Touch " + code_of(touch_->Finish()));
    statuses.add("WatchFinger " + code_of(watch_->Finish()));
    statuses.add("Estimate " + code_of(estimate_->Finish()));
  }

 private:
  void upload(const client::FramePair& pair, double share) {
    estimate_ = elastography_->Estimate(&contexts_[2]);
    v1::EstimateRequest request;
    *request.mutable_acquisition() = pair.acquisition;
    request.mutable_acquisition()->clear_maps();  // all
    if (!estimate_->Write(request)) return;
    for (const auto& [kind, bytes] :
         {std::pair<v1::FrameKind, const std::string&>{v1::FRAME_KIND_PRE, pair.pre},
          {v1::FRAME_KIND_POST, pair.post}})
      for (std::size_t at = 0; at < bytes.size(); at += kChunkBytes) {
        if (static_cast<double>(at) > 2 * share * static_cast<double>(bytes.size())) return;
        v1::FrameChunk& chunk = *request.mutable_chunk();
        chunk.set_frame(kind);
        chunk.set_offset_bytes(at);
        chunk.set_data(bytes.substr(at, kChunkBytes));
        if (!estimate_->Write(request)) return;
      }
    if (share == 1) estimate_->WritesDone();
  }
  std::unique_ptr<v1::Palpation::Stub> palpation_;
  std::unique_ptr<v1::Elastography::Stub> elastography_;
  std::array<grpc::ClientContext, 3> contexts_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::TouchRequest, v1::TouchResponse>> touch_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::WatchFingerRequest, v1::FingerState>> watch_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::EstimateRequest, v1::EstimateResponse>> estimate_;
  std::uint64_t sequence_ = 0;
};

// Poses for so long.
void pose_for(const Rogue& rogue, UnreadCalls& calls, std::chrono::seconds length) {
  const auto end = std::chrono::steady_clock::now() + length;
  while (!rogue.stop && std::chrono::steady_clock::now() < end) {
    calls.pose();
    std::this_thread::sleep_for(kPoseEvery);
  }
}

}  // namespace

std::unique_ptr<Rogue> start_never_reading(const Service& service, const std::string& scene_id,
                                           const client::FramePair& pair) {
  auto rogue = std::make_unique<Rogue>();
  rogue->threads.emplace_back([&rogue = *rogue, service, scene_id, &pair] {
    const auto channel = client::make_channel(service.address, service.credentials, "soak-never-reading");
    while (!rogue.stop) {
      UnreadCalls calls(channel, "", scene_id, pair, 1);
      pose_for(rogue, calls, kUnreadFor);
      calls.cancel();
      calls.finish(rogue.statuses);
    }
  });
  return rogue;
}

std::unique_ptr<Rogue> start_dying(const Service& service, const std::string& scene_id,
                                   const client::FramePair& pair) {
  auto rogue = std::make_unique<Rogue>();
  rogue->threads.emplace_back([&rogue = *rogue, service, scene_id, &pair] {
    while (!rogue.stop) {
      test::ResettableConnection connection(service.address);
      UnreadCalls calls(connection.channel(), "soak-dying", scene_id, pair, 0.5);
      pose_for(rogue, calls, kLifetime);
      connection.reset();
      calls.finish(rogue.statuses);
    }
  });
  return rogue;
}

}  // namespace teletact::bench::soak
