// Calls that say in their metadata which scene they are about, as a proxy wants them to.
#include <functional>
#include <map>
#include <string>

#include "tests/rpc/estimate_client.h"

namespace teletact::service {
namespace {

class NamedScene : public OnOneServer {
 protected:
  // Each call about scene "s"; a stream sends its first message and reads until it ends.
  using Calls = std::map<std::string, std::function<grpc::Status(grpc::ClientContext&)>>;
  template <class Stream, class Request, class Response>
  static grpc::Status end_of(Stream stream, const Request& first, Response response) {
    stream->Write(first);
    stream->WritesDone();
    while (stream->Read(&response)) continue;
    return stream->Finish();
  }
  Calls calls() const {
    return {{"CreateScene",
             [this](auto& context) {
               v1::Scene scene;
               return palpation->CreateScene(&context, uniform_scene("s"), &scene);
             }},
            {"GetScene",
             [this](auto& context) {
               v1::GetSceneRequest request;
               request.set_scene_id("s");
               v1::Scene scene;
               return palpation->GetScene(&context, request, &scene);
             }},
            {"PublishSlice",
             [this](auto& context) {
               v1::PublishSliceRequest request;
               request.set_scene_id("s");
               v1::PublishSliceResponse response;
               return palpation->PublishSlice(&context, request, &response);
             }},
            {"DeleteScene",
             [this](auto& context) {
               v1::DeleteSceneRequest request;
               request.set_scene_id("s");
               v1::DeleteSceneResponse response;
               return palpation->DeleteScene(&context, request, &response);
             }},
            {"Touch",
             [this](auto& context) {
               v1::TouchRequest request;
               *request.mutable_open() = Toucher::open_on("s");
               return end_of(palpation->Touch(&context), request, v1::TouchResponse());
             }},
            {"WatchFinger",
             [this](auto& context) {
               v1::WatchFingerRequest request;
               request.set_scene_id("s");
               return end_of(palpation->WatchFinger(&context), request, v1::FingerState());
             }},
            {"Estimate, published",
             [this](auto& context) {
               v1::EstimateRequest request;
               *request.mutable_acquisition() = acquisition("s");
               return end_of(elastography->Estimate(&context), request, v1::EstimateResponse());
             }},
            {"Estimate of a slice", [this](auto& context) {
               v1::EstimateRequest request;
               *request.mutable_acquisition() = acquisition();
               request.mutable_acquisition()->mutable_slice_of()->set_scene_id("s");
               return end_of(elastography->Estimate(&context), request, v1::EstimateResponse());
             }}};
  }
  const std::unique_ptr<v1::Palpation::Stub> palpation = v1::Palpation::NewStub(channel);
  const std::unique_ptr<v1::Elastography::Stub> elastography = v1::Elastography::NewStub(channel);
};

TEST_F(NamedScene, AnotherThanTheMessageSaysIsRefusedByEveryCall) {
  for (const auto& [name, call] : calls()) {
    SCOPED_TRACE(name);
    for (const char* other : {"t", "S", ""}) {
      grpc::ClientContext context;
      set_deadline(context);
      context.AddMetadata("teletact-scene", other);
      expect_refused(call(context), grpc::StatusCode::INVALID_ARGUMENT, "teletact-scene");
    }
    grpc::ClientContext twice;
    set_deadline(twice);
    for (const char* named : {"s", "t"}) twice.AddMetadata("teletact-scene", named);
    expect_refused(call(twice), grpc::StatusCode::INVALID_ARGUMENT, "teletact-scene");
  }
  Toucher toucher(channel, "s");
  EXPECT_TRUE(toucher.opened()) << "nothing was deleted";
}

TEST_F(NamedScene, TheMessagesOwnIsAsNone) {
  for (const auto& [name, call] : calls()) {
    if (name == "DeleteScene") continue;  // last
    SCOPED_TRACE(name);
    grpc::ClientContext plain, named;
    set_deadline(plain), set_deadline(named);
    named.AddMetadata("teletact-scene", "s");
    const grpc::Status without = call(plain), with = call(named);
    EXPECT_EQ(with.error_code(), without.error_code()) << with.error_message();
    EXPECT_EQ(with.error_message(), without.error_message());
  }
  grpc::ClientContext named;
  set_deadline(named);
  named.AddMetadata("teletact-scene", "s");
  EXPECT_TRUE(calls().at("DeleteScene")(named).ok());
  EXPECT_TRUE(server->create(uniform_scene("s")).ok());
}

}  // namespace
}  // namespace teletact::service
