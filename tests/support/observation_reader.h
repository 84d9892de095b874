// Palpation.Observe, read plainly.
#pragma once

#include "teletact/v1/palpation.grpc.pb.h"
#include "tests/support/state_reader.h"

namespace teletact {

class ObservationReader : public StateReader<v1::ObserveRequest, v1::Observation> {
 public:
  ObservationReader(v1::Palpation::StubInterface& stub, grpc::ClientContext& context,
                    const v1::ObserveOpen& open)
      : StateReader(stub.Observe(&context), request(open)) {}
  // Says that it is done, and reads what is left without acknowledging it.
  grpc::Status finish() {
    stream_->WritesDone();
    for (v1::Observation state; read_on(&state);) continue;
    return stream_->Finish();
  }

 private:
  static v1::ObserveRequest request(const v1::ObserveOpen& open) {
    v1::ObserveRequest request;
    *request.mutable_open() = open;
    return request;
  }
};

}  // namespace teletact
