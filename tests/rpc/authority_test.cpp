// Every call, by everybody, over everything: who may not is told so, and nothing is done.
#include <functional>
#include <map>
#include <vector>

#include "service/rpc/address.h"
#include "tests/rpc/guarded_server.h"
#include "tests/rpc/health.h"
#include "tests/support/finger_reader.h"
#include "tests/support/observation_reader.h"

namespace teletact::service {
namespace {

using grpc::StatusCode;

// A call as one may make it; the status it comes to when it is let through is stated beside.
struct Call {
  const char* name;
  std::function<grpc::Status(const Shown&)> make;
  StatusCode let_through;
  const char* roles;  // of p(atient), o(perator), (obser)v(er), a(dministrator): who may
};

std::unique_ptr<v1::Palpation::Stub> palpation(const Shown& who) {
  return v1::Palpation::NewStub(who.channel);
}

grpc::Status get_scene(const Shown& who, v1::SceneView view) {
  grpc::ClientContext context;
  who.on(context);
  v1::GetSceneRequest request;
  request.set_scene_id("s");
  request.set_view(view);
  v1::Scene scene;
  return palpation(who)->GetScene(&context, request, &scene);
}

grpc::Status list_scenes(const Shown& who, v1::ListScenesResponse* scenes) {
  grpc::ClientContext context;
  who.on(context);
  return palpation(who)->ListScenes(&context, {}, scenes);
}

grpc::Status create(const Shown& who, const std::string& scene_id) {
  grpc::ClientContext context;
  who.on(context);
  v1::CreateSceneRequest request;
  request.set_scene_id(scene_id);
  for (const double size_m : {0.1, 0.02}) request.mutable_geometry()->add_size_m(size_m);
  v1::Scene scene;
  return palpation(who)->CreateScene(&context, request, &scene);
}

grpc::Status remove(const Shown& who, const std::string& scene_id) {
  grpc::ClientContext context;
  who.on(context);
  v1::DeleteSceneRequest request;
  request.set_scene_id(scene_id);
  v1::DeleteSceneResponse response;
  return palpation(who)->DeleteScene(&context, request, &response);
}

// The stream's opening alone; `steers`: what it says of the finger.
grpc::Status touch(const Shown& who, bool* steers = nullptr) {
  grpc::ClientContext context;
  who.on(context);
  const auto stub = palpation(who);
  const auto stream = stub->Touch(&context);
  v1::TouchRequest request;
  *request.mutable_open() = Toucher::open_on("s");
  stream->Write(request);
  v1::TouchResponse response;
  if (stream->Read(&response) && steers) *steers = response.opened().steers();
  stream->WritesDone();
  while (stream->Read(&response)) {
  }
  return stream->Finish();
}

grpc::Status watch(const Shown& who) {
  grpc::ClientContext context;
  who.on(context);
  const auto stub = palpation(who);
  const auto stream = stub->WatchFinger(&context);
  v1::WatchFingerRequest request;
  request.set_scene_id("s");
  stream->Write(request);
  v1::FingerState state;
  stream->Read(&state);
  stream->WritesDone();
  while (stream->Read(&state)) {
  }
  return stream->Finish();
}

grpc::Status observe(const Shown& who) {
  grpc::ClientContext context;
  who.on(context);
  const auto stub = palpation(who);
  v1::ObserveOpen open;
  open.set_scene_id("s");
  ObservationReader reader(*stub, context, open);
  v1::Observation state;
  reader.read(&state);
  return reader.finish();
}

// An acquisition without samples, which who is let in is told.
grpc::Status estimate_by(const Shown& who, const v1::Acquisition& acquisition) {
  grpc::ClientContext context;
  who.on(context);
  const auto stub = v1::Elastography::NewStub(who.channel);
  const auto stream = stub->Estimate(&context);
  v1::EstimateRequest request;
  *request.mutable_acquisition() = acquisition;
  stream->Write(request);
  v1::EstimateResponse response;
  while (stream->Read(&response)) {
  }
  return stream->Finish();
}

v1::Acquisition published() {
  v1::Acquisition acquisition;
  acquisition.mutable_publish()->set_scene_id("s");
  return acquisition;
}

v1::Acquisition beside_slices() {
  v1::Acquisition acquisition;
  acquisition.mutable_slice_of()->set_scene_id("s");
  return acquisition;
}

grpc::Status info(const Shown& who) {
  grpc::ClientContext context;
  who.on(context);
  v1::GetInfoResponse response;
  return v1::Info::NewStub(who.channel)->GetInfo(&context, {}, &response);
}

grpc::Status publish_slice(const Shown& who) {
  grpc::ClientContext context;
  who.on(context);
  v1::PublishSliceRequest request;
  request.set_scene_id("s");
  v1::PublishSliceResponse response;
  return palpation(who)->PublishSlice(&context, request, &response);
}

const std::vector<Call>& calls() {
  static const std::vector<Call> all{
      {"GetInfo", info, StatusCode::OK, "pova"},
      {"ListScenes",
       [](const Shown& who) {
         v1::ListScenesResponse scenes;
         return list_scenes(who, &scenes);
       },
       StatusCode::OK, "pova"},
      {"GetScene", [](const Shown& who) { return get_scene(who, v1::SCENE_VIEW_BASIC); }, StatusCode::OK,
       "pova"},
      {"GetScene with maps", [](const Shown& who) { return get_scene(who, v1::SCENE_VIEW_FULL); },
       StatusCode::OK, "pova"},
      {"CreateScene", [](const Shown& who) { return create(who, "s"); }, StatusCode::ALREADY_EXISTS, "pa"},
      {"PublishSlice", publish_slice, StatusCode::FAILED_PRECONDITION, "pa"},
      {"Estimate", [](const Shown& who) { return estimate_by(who, {}); }, StatusCode::INVALID_ARGUMENT, "pa"},
      {"Estimate for a scene", [](const Shown& who) { return estimate_by(who, published()); },
       StatusCode::INVALID_ARGUMENT, "pa"},
      {"Estimate beside slices", [](const Shown& who) { return estimate_by(who, beside_slices()); },
       StatusCode::INVALID_ARGUMENT, "pa"},
      {"WatchFinger", watch, StatusCode::OK, "pa"},
      {"Observe", observe, StatusCode::OK, "pova"},
      {"Touch", [](const Shown& who) { return touch(who); }, StatusCode::OK, "ova"},
      {"DeleteScene", [](const Shown& who) { return remove(who, "s"); }, StatusCode::OK, "a"},
  };
  return all;
}

const std::vector<std::pair<std::string, char>> kRoles{
    {"patient", 'p'}, {"operator", 'o'}, {"observer", 'v'}, {"administrator", 'a'}};

std::string entries() {
  std::string all;
  for (const auto& [role, letter] : kRoles) all += entry_of(role, role);
  all += entry_of("late", "administrator", "expires = 2020-01-01T00:00:00Z\n");
  // Elsewhere everything, here nothing.
  all += "[[entry]]\nname = \"stranger\"\ntoken_sha256 = \"" + hex_of(digest_of("stranger-token")) +
         "\"\ncertificate = \"stranger\"\nroles = { other = \"administrator\" }\n";
  return all;
}

class Authority : public testing::TestWithParam<Transport> {
 protected:
  void SetUp() override {
    server = std::make_unique<GuardedServer>(GetParam(), entries());
    make_scene();
  }
  void TearDown() override {
    (*server)->core().calls.wait_until_none(Calls::Clock::now() + std::chrono::minutes(1));
    EXPECT_EQ((*server)->core().calls.count(), 0U);
  }
  void make_scene() {
    const grpc::Status made = create(server->as("administrator"), "s");
    ASSERT_TRUE(made.ok() || made.error_code() == StatusCode::ALREADY_EXISTS) << made.error_message();
  }
  bool has_scene() {
    for (const auto& scene : (*server)->core().scenes.list())
      if (scene->id() == "s") return true;
    return false;
  }
  std::uint64_t refused() const {
    std::uint64_t sum = 0;
    for (const auto& counts : (*server)->core().calls.counts())
      sum += counts.refused[static_cast<std::size_t>(Refusal::kAuthority)];
    return sum;
  }
  std::unique_ptr<GuardedServer> server;
};

TEST_P(Authority, EachRoleMayMakeItsCallsAndNoOther) {
  for (const auto& [role, letter] : kRoles) {
    const Shown who = server->as(role);
    for (const Call& call : calls()) {
      SCOPED_TRACE(std::string(call.name) + " by " + role);
      make_scene();
      const std::uint64_t before = refused();
      const grpc::Status status = call.make(who);
      if (std::string(call.roles).find(letter) != std::string::npos) {
        EXPECT_EQ(status.error_code(), call.let_through) << status.error_message();
        EXPECT_EQ(refused(), before);
        continue;
      }
      expect_refused(status, StatusCode::PERMISSION_DENIED, role);
      expect_refused(status, StatusCode::PERMISSION_DENIED, "administrator");  // who may
      EXPECT_EQ(refused(), before + 1);
      EXPECT_TRUE(has_scene());
    }
  }
}

TEST_P(Authority, WhoIsNotKnownMakesNone) {
  std::vector<std::pair<Shown, const char*>> nobody{{server->as("late"), "expired"}};
  if (GetParam() == Transport::kMutualTls) {
    nobody.push_back({server->as("unheard"), "unheard"});
    nobody.push_back({{server->channel("operator"), "wrong-token"}, "--token-file"});
  } else {
    nobody.push_back({{server->channel()}, "--token-file"});
    nobody.push_back({{server->channel(), "operator"}, "--token-file"});
    nobody.push_back({{server->channel(), hex_of(digest_of("operator-token"))}, "--token-file"});
    nobody.push_back({{server->channel(), "operator-token", "Basic "}, "authorization"});
  }
  for (const auto& [who, words] : nobody)
    for (const Call& call : calls()) {
      SCOPED_TRACE(std::string(call.name) + ": " + words);
      const std::uint64_t before = refused();
      expect_refused(call.make(who), StatusCode::UNAUTHENTICATED, words);
      EXPECT_EQ(refused(), before + 1);
      EXPECT_TRUE(has_scene());
    }
}

// Whoever has a role for another scene is not told what this one is, nor that it is there.
TEST_P(Authority, ARoleElsewhereIsNoneHere) {
  const Shown who = server->as("stranger");
  for (const Call& call : calls()) {
    SCOPED_TRACE(call.name);
    const std::string name = call.name;
    if (name == "GetInfo" || name == "ListScenes" || name == "Estimate") continue;  // of no scene
    expect_refused(call.make(who), StatusCode::PERMISSION_DENIED, "no role there");
  }
  v1::ListScenesResponse scenes;
  ASSERT_TRUE(list_scenes(who, &scenes).ok());
  EXPECT_EQ(scenes.scenes_size(), 0);
  expect_refused(remove(who, "nowhere"), StatusCode::PERMISSION_DENIED, "nowhere");
  expect_refused(create(who, ""), StatusCode::PERMISSION_DENIED, "file of access");
  ASSERT_TRUE(create(who, "other").ok());
  ASSERT_TRUE(list_scenes(who, &scenes).ok());
  ASSERT_EQ(scenes.scenes_size(), 1);
  EXPECT_EQ(scenes.scenes(0).scene_id(), "other");
  EXPECT_TRUE(remove(who, "other").ok());
}

TEST_P(Authority, AnObserverNeverSteers) {
  bool steers = true;
  ASSERT_TRUE(touch(server->as("observer"), &steers).ok());
  EXPECT_FALSE(steers);
  ASSERT_TRUE(touch(server->as("operator"), &steers).ok());
  EXPECT_TRUE(steers);
}

// A probe has no token; it has a connection, or not.
TEST_P(Authority, HealthIsToldToWhoCanConnect) {
  const int told =
      GetParam() == Transport::kMutualTls ? -static_cast<int>(StatusCode::UNAVAILABLE) : kServing;
  EXPECT_EQ(health_of(*server, "teletact.v1.Palpation"), told);
}

INSTANTIATE_TEST_SUITE_P(Everywhere, Authority, testing::ValuesIn(kTransports), [](const auto& info) {
  std::string name = name_of(info.param);
  std::erase(name, ' ');
  return name;
});

TEST(MutualTls, NeedsACertificateOfTheAuthority) {
  GuardedServer server(Transport::kMutualTls, entries());
  const Identity foreign = make_authority("foreign");
  const Shown without{server.channel(), "administrator-token"},
      wrong{server.channel(make_client(foreign, "administrator"))};
  for (const Shown& who : {without, wrong}) EXPECT_EQ(info(who).error_code(), StatusCode::UNAVAILABLE);
  EXPECT_TRUE(info(server.as("administrator")).ok());
  // A token that is shown counts, not the connection's certificate.
  const Shown both{server.channel("observer"), "administrator-token"};
  EXPECT_TRUE(create(both, "s").ok());
}

TEST(Unguarded, WithoutAFileEverybodyMayDoEverything) {
  RunningServer server("127.0.0.1:0");
  server->make_ready();
  const Shown nobody{server.channel()}, somebody{server.channel(), "any"};
  ASSERT_TRUE(create(nobody, "s").ok());
  for (const Call& call : calls()) EXPECT_EQ(call.make(somebody).error_code(), call.let_through) << call.name;
}

// What is told in the clear is everybody's.
TEST(GuardedAddress, TokensNeverLeaveThisMachineInTheClear) {
  ListenOptions options;
  options.listen = "0.0.0.0:0";
  options.access = "access.toml";
  options.allow_insecure_remote = true;
  try {
    prepare_address(options);
    ADD_FAILURE() << "listens";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("--tls-certificate"), std::string::npos) << error.what();
  }
  options.tls_certificate = options.tls_key = "some.pem";
  EXPECT_NO_THROW(prepare_address(options));
}

}  // namespace
}  // namespace teletact::service
