// Palpation.WatchFinger, read plainly.
#pragma once

#include <string>

#include "teletact/v1/palpation.grpc.pb.h"
#include "tests/support/state_reader.h"

namespace teletact {

class FingerReader : public StateReader<v1::WatchFingerRequest, v1::FingerState> {
 public:
  FingerReader(v1::Palpation::StubInterface& stub, grpc::ClientContext& context, const std::string& scene_id)
      : StateReader(stub.WatchFinger(&context), request(scene_id)) {}

 private:
  static v1::WatchFingerRequest request(const std::string& scene_id) {
    v1::WatchFingerRequest request;
    request.set_scene_id(scene_id);
    return request;
  }
};

}  // namespace teletact
