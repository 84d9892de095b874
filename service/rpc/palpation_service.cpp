#include "service/rpc/palpation_service.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <thread>

#include "service/rpc/convert.h"
#include "service/rpc/status.h"
#include "service/rpc/touch_reactor.h"
#include "service/rpc/wait.h"
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

namespace {

v1::FingerState finger_to(const Finger& finger, const Scene& scene, std::uint64_t instance) {
  v1::FingerState state;
  state.set_present(finger.present);
  state.set_scene_version(scene.snapshot()->version);
  if (finger.stamp_ns == 0) return state;
  for (const double x_m : finger.position_m) state.add_position_m(x_m);
  for (const double v_m_s : finger.velocity_m_s) state.add_velocity_m_s(v_m_s);
  state.mutable_stamp()->set_monotonic_ns(finger.stamp_ns);
  state.mutable_stamp()->set_instance(instance);
  return state;
}

}  // namespace

grpc::Status PalpationService::WatchFinger(
    grpc::ServerContext* context, grpc::ServerReaderWriter<v1::FingerState, v1::WatchFingerRequest>* stream) {
  return guarded([&] {
    using Clock = FingerBoard::Clock;
    constexpr std::chrono::milliseconds kLookForCancel{200};
    const auto period = std::chrono::duration_cast<Clock::duration>(
        std::chrono::duration<double>(1 / core_.limits.most_finger_rate_hz));
    core_.calls.require_open();  // first: until scenes are restored, one that is not found may yet be
    v1::WatchFingerRequest request;
    if (!stream->Read(&request))
      throw std::invalid_argument("scene_id: the first message of a watch must name the scene");
    const auto scene = core_.scenes.find(request.scene_id());
    const auto ticket = core_.calls.enter(CallKind::kWatch, [scene] { scene->finger().wake(); }, {});
    spdlog::info("event=watch_opened stream={} scene={} peer={}", ticket->id(), scene->id(), context->peer());
    Finger finger = scene->finger().now();
    bool changed = true;
    Clock::time_point heartbeat;
    v1::FingerState state;
    std::uint64_t states = 0;
    while (!context->IsCancelled() && !core_.calls.draining() && !scene->deleted()) {
      // One that rests is told all the same: watchers take silence for a dead link, and proxies for an idle
      // one.
      if (changed || Clock::now() >= heartbeat) {
        state = finger_to(finger, *scene, core_.instance);
        state.set_state(++states);
        if (!stream->Write(state)) break;
        heartbeat = Clock::now() + kFingerHeartbeat;
      }
      const std::uint64_t seen = finger.generation;
      if (changed) std::this_thread::sleep_for(period);
      finger = scene->finger().newer_than(seen, Clock::now() + kLookForCancel);
      changed = finger.generation != seen;
    }
    core_.calls.require_open();
    if (scene->deleted()) throw Error(ErrorKind::kAborted, fmt::format("scene {} was deleted", scene->id()));
    return grpc::Status::OK;
  });
}

grpc::ServerBidiReactor<v1::TouchRequest, v1::TouchResponse>* PalpationService::Touch(
    grpc::CallbackServerContext* context) {
  return new TouchReactor(core_, context);  // deletes itself when the call is done
}

}  // namespace teletact::service
