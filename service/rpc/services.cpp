#include "service/rpc/services.h"

#include <google/protobuf/message.h>

#include <algorithm>
#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "service/rpc/call_metadata.h"
#include "service/rpc/core.h"
#include "service/rpc/palpation_messages.h"
#include "service/rpc/served_call.h"
#include "service/scene/errors.h"
#include "service/scene/workers.h"
#include "teletact/v1/info.grpc.pb.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::service {

namespace {

// One unary call, answered from whatever thread has the answer; none waits for the peer meanwhile. It keeps
// its place, and with it what the answer holds, until the peer has taken the answer or time is up.
class UnaryCall final : public ServedCall<grpc::ServerUnaryReactor> {
 public:
  // Whoever is to answer holds this. When the last holder lets go of a call that is not answered, it ends
  // with UNAVAILABLE: the work was dropped because the service stops.
  using Handle = std::shared_ptr<UnaryCall>;
  struct Kind {
    const char* method;
    CallKind kind;
    Wanted wanted;  // what its caller has to be allowed to
  };
  // Called once the call has its place; what it throws is the answer.
  using Begin = std::function<void(const Handle&)>;

  static UnaryCall* serve(Core& core, grpc::CallbackServerContext* context, Kind kind, Begin begin) {
    const CallKind place = kind.kind;
    return ServedCall::serve(std::make_shared<UnaryCall>(core, context, std::move(kind), std::move(begin)),
                             place);
  }
  UnaryCall(Core& core, grpc::CallbackServerContext* context, Kind kind, Begin begin)
      : ServedCall(core, context, kind.method),
        core_(core),
        wanted_(std::move(kind.wanted)),
        begin_(std::move(begin)) {}

  bool may(const Wanted& wanted) const { return caller_.may(wanted); }

  // `work` fills the response; what it throws is the answer. Not run when the call was given up: request and
  // response may be gone then.
  template <class Work>
  void answer(const google::protobuf::Message& response, Work&& work) {
    during([&] {
      const auto begun = Clock::now();
      work();
      answered_ = StageTime{"answer", Clock::now() - begun};
      // A slow link is no reason to cut an answer that is being taken: 1 MiB/s is enough.
      const double more_s = static_cast<double>(response.ByteSizeLong()) / (1 << 20);
      patience_ = seconds(core_.limits.answer_taken_s + more_s);
      end(grpc::Status::OK);
    });
  }
  // `drop` takes back the job that was posted for it, where it has not begun: called when the call is given
  // up, so that nothing of it waits any more.
  void drop_by(std::function<void()> drop) {
    {
      const std::lock_guard lock(dropping_);
      drop_ = std::move(drop);
    }
    if (life().ended()) ended();  // before the job was known
  }
  // What it takes, until the peer has taken the answer. By whoever works for it.
  void hold(Charge memory) { held_ = std::move(memory); }
  void fail(std::exception_ptr error) { end(status_of(error)); }

 private:
  void begun() override {
    const Handle handle(this, [self = self()](UnaryCall* call) {
      call->end({grpc::StatusCode::UNAVAILABLE, "the service is shutting down; connect again later"});
    });
    const grpc::Status status = guarded([&] {
      require(wanted_);
      begin_(handle);
      return grpc::Status::OK;
    });
    if (!status.ok()) end(status);  // before the handle says that nobody answers
    begin_ = {};
  }
  void ended() override {
    if (life().status().ok()) return;
    std::function<void()> drop;
    {
      const std::lock_guard lock(dropping_);
      drop = std::exchange(drop_, {});
    }
    if (drop) drop();
  }
  Clock::duration patience() const override { return patience_.load(); }
  std::vector<StageTime> stages() const override {
    return answered_ ? std::vector{*answered_} : std::vector<StageTime>{};
  }

  Core& core_;
  const Wanted wanted_;
  Charge held_;
  Begin begin_;
  std::optional<StageTime> answered_;  // the response was filled
  std::atomic<Clock::duration> patience_{kEndTaken};
  std::mutex dropping_;
  std::function<void()> drop_;
};

void device_to(const DeviceInfo& device, v1::Device* out) {
  out->set_name(device.name);
  out->set_vendor(device.vendor);
  out->set_platform(device.platform);
  out->set_driver_version(device.driver_version);
  out->set_has_double(device.has_double);
  out->set_compute_units(device.compute_units);
  out->set_global_memory_bytes(device.global_memory_bytes);
}

// What is running here.
class InfoService final : public v1::Info::CallbackService {
 public:
  explicit InfoService(Core& core) : core_(core) {}
  grpc::ServerUnaryReactor* GetInfo(grpc::CallbackServerContext* context, const v1::GetInfoRequest*,
                                    v1::GetInfoResponse* response) override {
    return UnaryCall::serve(
        core_, context, {"teletact.v1.Info/GetInfo", CallKind::kInfo, {Need::kKnown, ""}},
        [=, this](const UnaryCall::Handle& call) { call->answer(*response, [&] { describe(response); }); });
  }

 private:
  void describe(v1::GetInfoResponse* response) const {
    response->set_api_version("v1");
    response->set_build(TELETACT_VERSION);
    response->set_instance(core_.instance);
    for (const CurrentDevice& device : core_.devices) device_to(device->info(), response->add_devices());
    *response->mutable_device() = response->devices(0);
    for (const LimitRow& row : limit_rows()) {
      v1::Limit* limit = response->add_limits();
      limit->set_name(row.name);
      limit->set_value(row.value(core_.limits));
      limit->set_unit(row.unit);
    }
    std::vector<MemoryUse> uses = core_.memory->uses();
    // A place that holds nothing says so: silence would leave open whether the service tells at all.
    std::vector<Place> places{Place::kHost};
    for (std::size_t k = 0; k < core_.devices.size(); ++k) places.push_back(place_of_device(k));
    for (const Place place : places)
      if (std::none_of(uses.begin(), uses.end(), [&](const auto& use) { return use.place == place; }))
        uses.push_back({place, "", 0});
    for (const MemoryUse& use : uses) {
      v1::MemoryUse* held = response->add_memory();
      held->set_place(name_of(use.place));
      held->set_kind(use.kind);
      held->set_bytes(use.bytes);
    }
    response->set_uptime_ns(
        std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now() - core_.started)
            .count());
  }
  Core& core_;
};

// Scenes, touch, and where the finger is.
class PalpationService final : public v1::Palpation::CallbackService {
 public:
  explicit PalpationService(Core& core) : core_(core) {}

  grpc::ServerUnaryReactor* CreateScene(grpc::CallbackServerContext* context,
                                        const v1::CreateSceneRequest* request, v1::Scene* response) override {
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
            call->answer(*response,
                         [&] { scene_to(*scene, v1::SCENE_VIEW_BASIC, core_.instance, response); });
          });
      call->drop_by([this, job] { core_.imaging.workers().cancel(job); });
    });
  }
  grpc::ServerUnaryReactor* PublishSlice(grpc::CallbackServerContext* context,
                                         const v1::PublishSliceRequest* request,
                                         v1::PublishSliceResponse* response) override {
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
  grpc::ServerUnaryReactor* GetScene(grpc::CallbackServerContext* context, const v1::GetSceneRequest* request,
                                     v1::Scene* response) override {
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
  grpc::ServerUnaryReactor* ListScenes(grpc::CallbackServerContext* context, const v1::ListScenesRequest*,
                                       v1::ListScenesResponse* response) override {
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
  grpc::ServerUnaryReactor* DeleteScene(grpc::CallbackServerContext* context,
                                        const v1::DeleteSceneRequest* request,
                                        v1::DeleteSceneResponse* response) override {
    const UnaryCall::Kind kind{
        "teletact.v1.Palpation/DeleteScene", CallKind::kUnary, {Need::kDelete, request->scene_id()}};
    return UnaryCall::serve(core_, context, kind, [=, this](const UnaryCall::Handle& call) {
      require_named(*context, request->scene_id());
      const auto job = removing_.post(
          [=, this] { call->answer(*response, [&] { core_.scenes.remove(request->scene_id()); }); });
      call->drop_by([this, job] { removing_.cancel(job); });
    });
  }
  grpc::ServerBidiReactor<v1::WatchFingerRequest, v1::FingerState>* WatchFinger(
      grpc::CallbackServerContext* context) override {
    return serve_watch(core_, context);
  }
  grpc::ServerBidiReactor<v1::TouchRequest, v1::TouchResponse>* Touch(
      grpc::CallbackServerContext* context) override {
    return serve_touch(core_, context);
  }
  grpc::ServerBidiReactor<v1::ObserveRequest, v1::Observation>* Observe(
      grpc::CallbackServerContext* context) override {
    return serve_observe(core_, copying_, context);
  }

 private:
  Core& core_;
  // Neither may hold up gRPC's threads, which touch needs: copying a scene's maps, and waiting for the disk.
  Workers copying_, removing_;
};

}  // namespace

std::unique_ptr<grpc::Service> info_service(Core& core) {
  return std::make_unique<InfoService>(core);
}

std::unique_ptr<grpc::Service> palpation_service(Core& core) {
  return std::make_unique<PalpationService>(core);
}

}  // namespace teletact::service
