// Scenes, touch, and where the finger is.
#pragma once

#include "service/rpc/core.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

class PalpationService final : public v1::Palpation::WithCallbackMethod_Touch<
                                   v1::Palpation::WithCallbackMethod_WatchFinger<v1::Palpation::Service>> {
 public:
  explicit PalpationService(Core& core) : core_(core) {}

  grpc::Status CreateScene(grpc::ServerContext*, const v1::CreateSceneRequest*, v1::Scene*) override;
  grpc::Status GetScene(grpc::ServerContext*, const v1::GetSceneRequest*, v1::Scene*) override;
  grpc::Status ListScenes(grpc::ServerContext*, const v1::ListScenesRequest*,
                          v1::ListScenesResponse*) override;
  grpc::Status DeleteScene(grpc::ServerContext*, const v1::DeleteSceneRequest*,
                           v1::DeleteSceneResponse*) override;
  grpc::ServerBidiReactor<v1::WatchFingerRequest, v1::FingerState>* WatchFinger(
      grpc::CallbackServerContext*) override;
  grpc::ServerBidiReactor<v1::TouchRequest, v1::TouchResponse>* Touch(grpc::CallbackServerContext*) override;

 private:
  Core& core_;
};

}  // namespace teletact::service
