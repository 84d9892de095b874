// A plain reader of Palpation.Observe: acknowledges each state before it reads the next.
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>

#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact {

class ObservationReader {
 public:
  ObservationReader(v1::Palpation::StubInterface& stub, grpc::ClientContext& context,
                    const v1::ObserveOpen& open)
      : stream_(stub.Observe(&context)) {
    v1::ObserveRequest request;
    *request.mutable_open() = open;
    stream_->Write(request);
  }
  bool send(const v1::ObserveRequest& request) { return stream_->Write(request); }
  bool read_on(v1::Observation* state) { return stream_->Read(state); }  // without acknowledging
  bool read(v1::Observation* state) {
    if (last_ > 0) {
      v1::ObserveRequest request;
      request.set_acknowledged(last_);
      stream_->Write(request);
    }
    if (!stream_->Read(state)) return false;
    last_ = state->state();
    return true;
  }
  // Reads what is left.
  grpc::Status finish() {
    stream_->WritesDone();
    for (v1::Observation state; stream_->Read(&state);) {
    }
    return stream_->Finish();
  }

 private:
  std::unique_ptr<grpc::ClientReaderWriterInterface<v1::ObserveRequest, v1::Observation>> stream_;
  std::uint64_t last_ = 0;
};

}  // namespace teletact
