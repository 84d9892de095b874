// A plain reader of Palpation.WatchFinger: acknowledges each state before it reads the next.
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>

#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact {

class FingerReader {
 public:
  FingerReader(v1::Palpation::StubInterface& stub, grpc::ClientContext& context, const std::string& scene_id)
      : stream_(stub.WatchFinger(&context)) {
    v1::WatchFingerRequest request;
    request.set_scene_id(scene_id);
    stream_->Write(request);
  }
  bool read(v1::FingerState* state) {
    if (last_ > 0) {
      v1::WatchFingerRequest request;
      request.set_acknowledged(last_);
      stream_->Write(request);
    }
    if (!stream_->Read(state)) return false;
    last_ = state->state();
    return true;
  }
  // Reads what is left.
  grpc::Status finish() {
    for (v1::FingerState state; read(&state);) {
    }
    return stream_->Finish();
  }

 private:
  std::unique_ptr<grpc::ClientReaderWriterInterface<v1::WatchFingerRequest, v1::FingerState>> stream_;
  std::uint64_t last_ = 0;
};

}  // namespace teletact
