// What the tests of estimates share: one service, its warmed engine, and a scene to publish into.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <thread>

#include "tests/rpc/estimate_client.h"

namespace teletact::service {

// Beside the scene "s", which is touched, an empty one to publish into.
class Estimates : public OnOneServer {
 protected:
  Estimates() {
    v1::CreateSceneRequest request;
    request.set_scene_id("scene");
    request.mutable_geometry()->add_size_m(0.1);
    request.mutable_geometry()->add_size_m(0.02);
    EXPECT_TRUE(server->create(request).ok());
  }
  ~Estimates() override { EXPECT_TRUE(server->remove("scene").ok()); }
  v1::Scene scene() {
    grpc::ClientContext context;
    v1::GetSceneRequest request;
    request.set_scene_id("scene");
    request.set_view(v1::SCENE_VIEW_FULL);
    v1::Scene scene;
    EXPECT_TRUE(palpation->GetScene(&context, request, &scene).ok());
    return scene;
  }
  Outcome estimate(const v1::Acquisition& a, const std::string& pre, const std::string& post) {
    return service::estimate(channel, a, {pre, post});
  }
  // Returns once the call's place is free: when gRPC is done with it, a little after it is answered.
  static void expect_refused(const Outcome& outcome, grpc::StatusCode code, const char* field) {
    service::expect_refused(outcome.status, code, field);
    EXPECT_TRUE(outcome.maps.empty());
    const auto give_up = Calls::Clock::now() + std::chrono::minutes(1);
    while ((*server)->core().calls.count(CallKind::kEstimate) > 0 && Calls::Clock::now() < give_up)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  const std::unique_ptr<v1::Palpation::Stub> palpation = v1::Palpation::NewStub(channel);
};

}  // namespace teletact::service
