#include "client/acquire/estimate_client.h"

#include <chrono>
#include <thread>

#include "client/clock/clock.h"
#include "client/link/channel.h"
#include "client/link/retry.h"
#include "client/link/scenes.h"
#include "teletact/v1/info.grpc.pb.h"

namespace teletact::client {
namespace {

constexpr std::size_t kChunkBytes = std::size_t{1} << 20;  // the contract's largest chunk
constexpr auto kCallDeadline = std::chrono::seconds(120);  // a slow device estimates large frames for seconds

using Stream = grpc::ClientReaderWriter<v1::EstimateRequest, v1::EstimateResponse>;

// False when the service has ended the call; Finish then says why.
bool send(Stream& stream, const v1::EstimateRequest& request, const EstimateCallbacks& callbacks) {
  if (callbacks.request) callbacks.request(request);
  return stream.Write(request);
}

bool send_frame(Stream& stream, v1::FrameKind kind, const std::string& bytes,
                const EstimateCallbacks& callbacks) {
  v1::EstimateRequest request;
  for (std::size_t offset = 0; offset < bytes.size(); offset += kChunkBytes) {
    v1::FrameChunk& chunk = *request.mutable_chunk();
    chunk.set_frame(kind);
    chunk.set_offset_bytes(offset);
    chunk.set_data(bytes.substr(offset, kChunkBytes));
    if (!send(stream, request, callbacks)) return false;
  }
  return true;
}

void read_all(Stream& stream, const EstimateCallbacks& callbacks, EstimateOutcome& outcome) {
  v1::EstimateResponse response;
  while (stream.Read(&response)) {
    if (callbacks.response) callbacks.response(response);
    if (response.has_map()) outcome.maps.push_back(response.map().map());
    if (!response.has_summary()) continue;
    outcome.published_ns = monotonic_ns();
    outcome.summary = response.summary();
  }
}

}  // namespace

void throw_status(const char* call, const grpc::Status& status) {
  throw ServiceError(status.error_code(), std::string(call) + ": " + describe(status));
}

v1::GetInfoResponse get_info(const std::shared_ptr<grpc::Channel>& channel) {
  v1::GetInfoResponse info;
  grpc::ClientContext context;
  const grpc::Status status = v1::Info::NewStub(channel)->GetInfo(&context, {}, &info);
  if (!status.ok()) throw_status("GetInfo", status);
  return info;
}

EstimateClient::EstimateClient(const std::shared_ptr<grpc::Channel>& channel, double retry_for_s)
    : stub_(v1::Elastography::NewStub(channel)), retry_for_s_(retry_for_s) {}

EstimateOutcome EstimateClient::estimate(const v1::Acquisition& acquisition, const std::string& pre,
                                         const std::string& post, const EstimateCallbacks& callbacks,
                                         const std::atomic<bool>& stop) {
  const std::int64_t give_up_ns = monotonic_ns() + static_cast<std::int64_t>(retry_for_s_ * 1e9);
  Backoff backoff(0.05, 0.5);
  EstimateOutcome outcome;
  while (true) {
    ++outcome.attempts;
    const grpc::Status status = attempt(acquisition, pre, post, callbacks, outcome);
    if (status.ok()) return outcome;
    if (status.error_code() != grpc::StatusCode::UNAVAILABLE || monotonic_ns() > give_up_ns)
      throw_status("Estimate", status);
    if (outcome.attempts == 1 && callbacks.waiting)
      callbacks.waiting("waiting for the service (" + describe(status) + ")");
    if (stop) throw ServiceError(grpc::StatusCode::CANCELLED, "Estimate: stopped");
    std::this_thread::sleep_for(std::chrono::duration<double>(backoff.next_s()));
  }
}

void EstimateClient::cancel() {
  const std::lock_guard lock(mutex_);
  if (going_on_) going_on_->TryCancel();
}

grpc::Status EstimateClient::attempt(const v1::Acquisition& acquisition, const std::string& pre,
                                     const std::string& post, const EstimateCallbacks& callbacks,
                                     EstimateOutcome& outcome) {
  // Outlives the call: who cancels may be late.
  const auto going_on = std::make_shared<grpc::ClientContext>();
  grpc::ClientContext& context = *going_on;
  if (acquisition.has_publish()) name_scene(context, acquisition.publish().scene_id());
  if (acquisition.has_slice_of()) name_scene(context, acquisition.slice_of().scene_id());
  context.set_deadline(std::chrono::system_clock::now() + kCallDeadline);
  {
    const std::lock_guard lock(mutex_);
    going_on_ = going_on;
  }
  const auto stream = stub_->Estimate(&context);
  v1::EstimateRequest first;
  *first.mutable_acquisition() = acquisition;
  outcome.maps.clear();
  outcome.published_ns = 0;
  // A service that refuses early resets the stream, which ends the writing too.
  if (send(*stream, first, callbacks) && send_frame(*stream, v1::FRAME_KIND_PRE, pre, callbacks) &&
      send_frame(*stream, v1::FRAME_KIND_POST, post, callbacks))
    stream->WritesDone();
  outcome.last_byte_ns = monotonic_ns();
  read_all(*stream, callbacks, outcome);
  const grpc::Status status = stream->Finish();
  if (status.ok() && outcome.published_ns == 0)
    return {grpc::StatusCode::INTERNAL, "the service ended the call without a summary"};
  return status;
}

}  // namespace teletact::client
