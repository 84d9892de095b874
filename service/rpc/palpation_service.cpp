#include "service/rpc/palpation_service.h"

#include "service/rpc/call_metadata.h"
#include "service/rpc/modulus_messages.h"
#include "service/rpc/observe_reactor.h"
#include "service/rpc/palpation_messages.h"
#include "service/rpc/touch_reactor.h"
#include "service/rpc/unary_call.h"
#include "service/rpc/watch_reactor.h"
#include "service/scene/errors.h"

namespace teletact::service {

grpc::ServerUnaryReactor* PalpationService::CreateScene(grpc::CallbackServerContext* context,
                                                        const v1::CreateSceneRequest* request,
                                                        v1::Scene* response) {
  const UnaryCall::Kind kind{
      "teletact.v1.Palpation/CreateScene",
      CallKind::kUnary,
      {Need::kPublish, request->scene_id().empty() ? kEveryScene : request->scene_id()}};
  return UnaryCall::serve(core_, context, kind, [=, this](const UnaryCall::Handle& call) {
    require_named(*context, request->scene_id());
    const std::string client = client_of(*context);
    // The request, and what is read from it: numbers of 4 bytes become such of 8. Slices are then stacked.
    call->hold(core_.account(client).charge(Place::kHost, "uploads",
                                            (request->slices().empty() ? 3 : 5) * request->ByteSizeLong()));
    const SceneGeometry geometry = geometry_from(request->geometry(), core_.limits);
    std::optional<ExplicitModulus> modulus = modulus_from(*request, core_.limits);
    const auto job = core_.imaging.make_scene(
        request->scene_id(), geometry, std::move(modulus), client,
        [=, this](const std::shared_ptr<Scene>& scene, std::exception_ptr error) {
          if (error) return call->fail(error);
          call->answer(*response, [&] { scene_to(*scene, v1::SCENE_VIEW_BASIC, core_.instance, response); });
        });
    call->drop_by([this, job] { core_.imaging.workers().cancel(job); });
  });
}

grpc::ServerUnaryReactor* PalpationService::PublishSlice(grpc::CallbackServerContext* context,
                                                         const v1::PublishSliceRequest* request,
                                                         v1::PublishSliceResponse* response) {
  const UnaryCall::Kind kind{
      "teletact.v1.Palpation/PublishSlice", CallKind::kUnary, {Need::kPublish, request->scene_id()}};
  return UnaryCall::serve(core_, context, kind, [=, this](const UnaryCall::Handle& call) {
    require_named(*context, request->scene_id());
    const std::string client = client_of(*context);
    call->hold(core_.account(client).charge(Place::kHost, "uploads", 3 * request->ByteSizeLong()));
    const auto scene = core_.scenes.find(request->scene_id());
    const auto job =
        core_.imaging.publish_slice(scene, slice_from("slice", request->slice(), *scene->solid()), client,
                                    [=](const Published& published, std::exception_ptr error) {
                                      if (error) return call->fail(error);
                                      call->answer(*response, [&] {
                                        response->set_window_id(published.window_id);
                                        response->set_version(published.version);
                                        for (const std::string& warning : published.warnings)
                                          response->add_warnings(warning);
                                      });
                                    });
    call->drop_by([this, job] { core_.imaging.workers().cancel(job); });
  });
}

grpc::ServerUnaryReactor* PalpationService::GetScene(grpc::CallbackServerContext* context,
                                                     const v1::GetSceneRequest* request,
                                                     v1::Scene* response) {
  const CallKind place = request->view() == v1::SCENE_VIEW_FULL ? CallKind::kFullScene : CallKind::kUnary;
  const UnaryCall::Kind kind{"teletact.v1.Palpation/GetScene", place, {Need::kRead, request->scene_id()}};
  return UnaryCall::serve(core_, context, kind, [=, this](const UnaryCall::Handle& call) {
    require_named(*context, request->scene_id());
    const auto job = copying_.post([=, this, client = client_of(*context)] {
      call->answer(*response, [&] {
        const auto scene = core_.scenes.find(request->scene_id());
        call->hold(core_.account(client, scene->id())
                       .charge(Place::kHost, "answers", scene_bytes(*scene, request->view())));
        scene_to(*scene, request->view(), core_.instance, response);
      });
    });
    call->drop_by([this, job] { copying_.cancel(job); });
  });
}

grpc::ServerUnaryReactor* PalpationService::ListScenes(grpc::CallbackServerContext* context,
                                                       const v1::ListScenesRequest*,
                                                       v1::ListScenesResponse* response) {
  const UnaryCall::Kind kind{"teletact.v1.Palpation/ListScenes", CallKind::kUnary, {Need::kRead, ""}};
  return UnaryCall::serve(core_, context, kind, [=, this](const UnaryCall::Handle& call) {
    const auto job = copying_.post([=, this, client = client_of(*context)] {
      call->answer(*response, [&] {
        auto scenes = core_.scenes.list();
        std::erase_if(scenes, [&](const auto& scene) { return !call->may({Need::kRead, scene->id()}); });
        std::uint64_t bytes = 0;
        for (const auto& scene : scenes) bytes += scene_bytes(*scene, v1::SCENE_VIEW_BASIC);
        call->hold(core_.account(client).charge(Place::kHost, "answers", bytes));
        for (const auto& scene : scenes)
          scene_to(*scene, v1::SCENE_VIEW_BASIC, core_.instance, response->add_scenes());
      });
    });
    call->drop_by([this, job] { copying_.cancel(job); });
  });
}

grpc::ServerUnaryReactor* PalpationService::DeleteScene(grpc::CallbackServerContext* context,
                                                        const v1::DeleteSceneRequest* request,
                                                        v1::DeleteSceneResponse* response) {
  const UnaryCall::Kind kind{
      "teletact.v1.Palpation/DeleteScene", CallKind::kUnary, {Need::kDelete, request->scene_id()}};
  return UnaryCall::serve(core_, context, kind, [=, this](const UnaryCall::Handle& call) {
    require_named(*context, request->scene_id());
    const auto job = removing_.post(
        [=, this] { call->answer(*response, [&] { core_.scenes.remove(request->scene_id()); }); });
    call->drop_by([this, job] { removing_.cancel(job); });
  });
}

grpc::ServerBidiReactor<v1::WatchFingerRequest, v1::FingerState>* PalpationService::WatchFinger(
    grpc::CallbackServerContext* context) {
  return WatchReactor::serve(core_, context);
}

grpc::ServerBidiReactor<v1::ObserveRequest, v1::Observation>* PalpationService::Observe(
    grpc::CallbackServerContext* context) {
  return ObserveReactor::serve(core_, copying_, context);
}

grpc::ServerBidiReactor<v1::TouchRequest, v1::TouchResponse>* PalpationService::Touch(
    grpc::CallbackServerContext* context) {
  return TouchReactor::serve(core_, context);
}

}  // namespace teletact::service
