// Scenes, touch, and where the finger is.
#pragma once

#include "service/rpc/core.h"
#include "service/scene/workers.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

class PalpationService final : public v1::Palpation::CallbackService {
 public:
  explicit PalpationService(Core& core) : core_(core) {}

  grpc::ServerUnaryReactor* CreateScene(grpc::CallbackServerContext*, const v1::CreateSceneRequest*,
                                        v1::Scene*) override;
  grpc::ServerUnaryReactor* PublishSlice(grpc::CallbackServerContext*, const v1::PublishSliceRequest*,
                                         v1::PublishSliceResponse*) override;
  grpc::ServerUnaryReactor* GetScene(grpc::CallbackServerContext*, const v1::GetSceneRequest*,
                                     v1::Scene*) override;
  grpc::ServerUnaryReactor* ListScenes(grpc::CallbackServerContext*, const v1::ListScenesRequest*,
                                       v1::ListScenesResponse*) override;
  grpc::ServerUnaryReactor* DeleteScene(grpc::CallbackServerContext*, const v1::DeleteSceneRequest*,
                                        v1::DeleteSceneResponse*) override;
  grpc::ServerBidiReactor<v1::WatchFingerRequest, v1::FingerState>* WatchFinger(
      grpc::CallbackServerContext*) override;
  grpc::ServerBidiReactor<v1::TouchRequest, v1::TouchResponse>* Touch(grpc::CallbackServerContext*) override;
  grpc::ServerBidiReactor<v1::ObserveRequest, v1::Observation>* Observe(
      grpc::CallbackServerContext*) override;

 private:
  Core& core_;
  // Neither may hold up gRPC's threads, which touch needs: copying a scene's maps, and waiting for the disk.
  Workers copying_, removing_;
};

}  // namespace teletact::service
