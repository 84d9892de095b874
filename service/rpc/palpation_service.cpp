#include "service/rpc/palpation_service.h"

#include "service/rpc/convert.h"
#include "service/rpc/status.h"
#include "service/rpc/touch_reactor.h"
#include "service/rpc/wait.h"
#include "service/rpc/watch_reactor.h"
#include "service/scene/errors.h"

namespace teletact::service {

grpc::Status PalpationService::CreateScene(grpc::ServerContext* context,
                                           const v1::CreateSceneRequest* request, v1::Scene* response) {
  return guarded([&] {
    core_.calls.require_open();
    const SceneGeometry geometry = geometry_from(request->geometry(), core_.limits);
    std::optional<ExplicitModulus> modulus;
    if (request->has_modulus()) modulus = modulus_from(request->modulus(), core_.limits.most_scene_elements);
    // Building a model is imaging work: on its thread, below touch.
    const Abandoned abandoned = not_abandoned();
    auto made = core_.scenes.worker().run(
        [this, abandoned, id = request->scene_id(), geometry, modulus = std::move(modulus)]() mutable {
          if (*abandoned) throw Error(ErrorKind::kCancelled, "the caller cancelled");
          return core_.scenes.create(id, geometry, std::move(modulus));
        });
    scene_to(*wait_for(made, *context, abandoned), v1::SCENE_VIEW_BASIC, core_.instance, response);
    return grpc::Status::OK;
  });
}

grpc::Status PalpationService::GetScene(grpc::ServerContext*, const v1::GetSceneRequest* request,
                                        v1::Scene* response) {
  return guarded([&] {
    core_.calls.require_open();
    scene_to(*core_.scenes.find(request->scene_id()), request->view(), core_.instance, response);
    return grpc::Status::OK;
  });
}

grpc::Status PalpationService::ListScenes(grpc::ServerContext*, const v1::ListScenesRequest*,
                                          v1::ListScenesResponse* response) {
  return guarded([&] {
    core_.calls.require_open();
    for (const auto& scene : core_.scenes.list())
      scene_to(*scene, v1::SCENE_VIEW_BASIC, core_.instance, response->add_scenes());
    return grpc::Status::OK;
  });
}

grpc::Status PalpationService::DeleteScene(grpc::ServerContext*, const v1::DeleteSceneRequest* request,
                                           v1::DeleteSceneResponse*) {
  return guarded([&] {
    core_.calls.require_open();
    core_.scenes.remove(request->scene_id());
    return grpc::Status::OK;
  });
}

grpc::ServerBidiReactor<v1::WatchFingerRequest, v1::FingerState>* PalpationService::WatchFinger(
    grpc::CallbackServerContext* context) {
  return WatchReactor::serve(core_, context);
}

grpc::ServerBidiReactor<v1::TouchRequest, v1::TouchResponse>* PalpationService::Touch(
    grpc::CallbackServerContext* context) {
  return TouchReactor::serve(core_, context);
}

}  // namespace teletact::service
