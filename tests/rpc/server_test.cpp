#include <netdb.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <grpcpp/impl/codegen/client_unary_call.h>
#include <grpcpp/support/byte_buffer.h>

#include <fstream>

#include "service/rpc/call_metadata.h"
#include "tests/rpc/health.h"
#include "tests/rpc/running_server.h"
#include "tests/support/finger_reader.h"
#include "tests/support/localhost.h"

namespace teletact::service {
namespace {

namespace fs = std::filesystem;

std::string why_refused(const std::string& listen, bool allow_insecure_remote = false) {
  ListenOptions options;
  options.listen = listen;
  options.allow_insecure_remote = allow_insecure_remote;
  try {
    prepare_address(options);
    return "";
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    return error.what();
  }
}

TEST(Address, RemoteWithoutEncryptionIsRefusedUnlessAskedForByName) {
  const auto is_asked_for = [](const char* address, bool allowed = false) {
    return why_refused(address, allowed).find("--allow-insecure-remote") != std::string::npos;
  };
  for (const char* address : {"0.0.0.0:0", "192.168.1.7:0", "[::]:0"}) {
    EXPECT_TRUE(is_asked_for(address)) << address;
    EXPECT_FALSE(is_asked_for(address, true)) << address;
  }
  EXPECT_TRUE(is_asked_for("node7:0"));
  EXPECT_EQ(why_refused("0.0.0.0:0", true), "");
  EXPECT_FALSE(is_asked_for("[::1]:0")) << "on a machine without IPv6, something else is wrong";
  for (const char* address : {"127.0.0.1:0", "127.9.9.9:0"}) EXPECT_EQ(why_refused(address), "") << address;
  const std::string unknown = std::string("--listen localhost:0: ") + gai_strerror(EAI_NONAME);
  EXPECT_EQ(why_refused("localhost:0"), test::knows_localhost() ? "" : unknown);
}

TEST(Address, MalformedOnesAreRefused) {
  for (const char* address : {"", "127.0.0.1", ":50051", "127.0.0.1:", "127.0.0.1:x", "127.0.0.1:65536",
                              "127.0.0.1:-1", "unix:", "unix:/no/such/folder/s"})
    EXPECT_NE(why_refused(address), "") << address;
  EXPECT_NE(why_refused("unix:/tmp/" + std::string(103, 'x')).find("107"), std::string::npos);
  EXPECT_EQ(why_refused("unix:/tmp/" + std::string(102, 'x')), "");
  ListenOptions half;
  half.tls_certificate = "cert.pem";
  EXPECT_THROW(prepare_address(half), std::runtime_error);
}

// Or a start would say "23 of 151" of another number.
TEST(Server, SaysHowManyStepsCompilingTakes) {
  const std::size_t before = compile_steps();
  RunningServer server("", "", {}, tissue_models(), {DeviceOptions{}});
  server->make_ready();
  if (!server->core().devices.front()->info().has_double) GTEST_SKIP() << "fewer without double precision";
  EXPECT_NEAR(static_cast<double>(compile_steps() - before), Server::kCompileSteps, 8);
}

// Two that start at the same moment: neither listens yet.
TEST(Address, ASocketIsHeldFromWhenItIsLookedAt) {
  const std::string path = fs::temp_directory_path() / ("teletact-held-" + std::to_string(getpid()));
  ListenOptions options;
  options.listen = "unix:" + path;
  auto first = prepare_address(options);
  EXPECT_NE(why_refused(options.listen).find("in use"), std::string::npos);
  first.held.reset();
  EXPECT_EQ(why_refused(options.listen), "");
  fs::remove(path + ".lock");
}

TEST(Address, LiveSocketIsNotStolenAndADeadOneIsReplaced) {
  RunningServer first;
  const std::string address = first->address(), path = address.substr(5);
  EXPECT_NE(why_refused(address).find("in use"), std::string::npos);
  EXPECT_THROW(RunningServer second(address), std::runtime_error);
  EXPECT_TRUE(fs::is_socket(path));
  const std::string dead = path + "-dead", file = path + "-file";
  sockaddr_un bound{};
  bound.sun_family = AF_UNIX;
  dead.copy(bound.sun_path, sizeof(bound.sun_path) - 1);
  const int fd = ::socket(AF_UNIX, SOCK_STREAM, 0);
  ASSERT_EQ(::bind(fd, reinterpret_cast<sockaddr*>(&bound), sizeof(bound)), 0);
  ::close(fd);
  ASSERT_TRUE(fs::is_socket(dead));
  EXPECT_EQ(why_refused("unix:" + dead), "");
  EXPECT_FALSE(fs::exists(dead));
  std::ofstream(file) << "precious";
  EXPECT_NE(why_refused("unix:" + file), "");
  EXPECT_TRUE(fs::exists(file));
}

bool resolves(const char* host) {
  addrinfo* found = nullptr;
  const bool known = getaddrinfo(host, nullptr, nullptr, &found) == 0;
  if (known) freeaddrinfo(found);
  return known;
}

TEST(Address, BusyPortIsOneClearLine) {
  RunningServer first("127.0.0.1:0");
  try {
    RunningServer second(first->address());
    FAIL() << "two servers share a port";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("in use"), std::string::npos);
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
  }
  // localhost is 127.0.0.1 and, here and there, ::1: one of them alone would be a different service.
  if (!resolves("localhost")) return;  // a bare root without /etc/hosts
  const std::string port = first->address().substr(first->address().rfind(':'));
  EXPECT_NE(why_refused("localhost" + port).find("in use"), std::string::npos);
}

TEST(Server, HealthIsPerServiceAndServingOnlyWhenReady) {
  constexpr int kNotFound = -5;
  RunningServer server;
  for (const char* service : {"", "teletact.v1.Palpation", "teletact.v1.Elastography", "teletact.v1.Info"})
    EXPECT_EQ(health_of(server, service), kNotServing) << service;
  v1::ListScenesResponse scenes;
  grpc::ClientContext early;
  EXPECT_EQ(v1::Palpation::NewStub(server.channel())->ListScenes(&early, {}, &scenes).error_code(),
            grpc::StatusCode::UNAVAILABLE);
  // Its scenes may not be restored yet: no caller is told that one does not exist.
  grpc::ClientContext watching;
  const auto early_stub = v1::Palpation::NewStub(server.channel());
  EXPECT_EQ(FingerReader(*early_stub, watching, "s").finish().error_code(), grpc::StatusCode::UNAVAILABLE);
  server->make_ready();
  for (const char* service : {"", "teletact.v1.Palpation", "teletact.v1.Elastography", "teletact.v1.Info"})
    EXPECT_EQ(health_of(server, service), kServing) << service;
  EXPECT_EQ(health_of(server, "teletact.v1.Nothing"), kNotFound);
}

// What is open before authority is health alone.
TEST(Server, MethodsThatThereAreNotAreUnimplemented) {
  RunningServer server;
  const auto channel = server.channel();
  for (const char* name :
       {"/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", "/teletact.v1.Palpation/Nothing"}) {
    grpc::ClientContext context;
    set_deadline(context);
    grpc::internal::RpcMethod method(name, grpc::internal::RpcMethod::BIDI_STREAMING);
    const std::unique_ptr<grpc::ClientReaderWriter<grpc::ByteBuffer, grpc::ByteBuffer>> stream(
        grpc::internal::ClientReaderWriterFactory<grpc::ByteBuffer, grpc::ByteBuffer>::Create(
            channel.get(), method, &context));
    grpc::ByteBuffer answer;
    EXPECT_FALSE(stream->Read(&answer));
    EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::UNIMPLEMENTED) << name;
  }
}

TEST(Server, SaysWhatItIs) {
  RunningServer server("127.0.0.1:0");
  grpc::ClientContext context;
  v1::GetInfoResponse info;
  ASSERT_TRUE(v1::Info::NewStub(server.channel())->GetInfo(&context, {}, &info).ok());
  EXPECT_EQ(info.api_version(), "v1");
  EXPECT_NE(info.build(), "");
  EXPECT_NE(info.instance(), 0U);
  EXPECT_EQ(info.device().name(), rpc_device()->info().name);
  ASSERT_EQ(static_cast<std::size_t>(info.limits_size()), limit_rows().size());
  for (int k = 0; k < info.limits_size(); ++k) {
    const LimitRow& row = limit_rows()[static_cast<std::size_t>(k)];
    EXPECT_EQ(info.limits(k).name(), row.name);
    EXPECT_EQ(info.limits(k).unit(), row.unit);
    EXPECT_EQ(info.limits(k).value(), row.value(server->core().limits));
    EXPECT_GT(info.limits(k).value(), 0) << row.name;  // memory too: in bytes of this machine
  }
  EXPECT_GT(info.uptime_ns(), 0);
}

// Whoever gives the same name from the same machine is one client; the name is the client's text.
TEST(Server, AClientIsKnownByItsNameAndHost) {
  EXPECT_EQ(client_name("", "ipv4:127.0.0.1:5000"), "127.0.0.1");
  EXPECT_EQ(client_name("", "ipv4:127.0.0.1:6000"), "127.0.0.1");
  EXPECT_EQ(client_name("", "ipv6:%5B::1%5D:5000"), "%5B::1%5D");
  EXPECT_EQ(client_name("", "unix:"), "local");
  EXPECT_EQ(client_name("anna", "unix:/tmp/x"), "anna@local");
  EXPECT_NE(client_name("anna", "ipv4:10.0.0.1:5000"), client_name("anna", "ipv4:10.0.0.2:5000"));
  EXPECT_EQ(client_name("a\nb\"", "ipv4:10.0.0.1:5000"), "a?b?@10.0.0.1");
  EXPECT_LT(client_name(std::string(100000, 'a'), "ipv4:10.0.0.1:5000").size(), 100U);
}

TEST(Server, DrainTellsTheStreamsAndEndsSoon) {
  RunningServer server;
  server->make_ready();
  const auto channel = server.channel();
  const auto stub = v1::Palpation::NewStub(channel);
  grpc::ClientContext watching;
  ASSERT_TRUE(server.create(uniform_scene("s")).ok());
  Toucher busy(channel, "s"), silent(channel, "s");
  ASSERT_TRUE(busy.opened() && silent.opened());
  silent.stop_acknowledging();
  v1::TouchAnswer answer;
  ASSERT_TRUE(busy.touch(0.05, 0.002, &answer) && silent.touch(0.05, 0.002, &answer));
  FingerReader finger(*stub, watching, "s");
  v1::FingerState state;
  ASSERT_TRUE(finger.read(&state));
  const auto begun = std::chrono::steady_clock::now();
  server->drain();
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::seconds(2));
  EXPECT_EQ(busy.finish().error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(silent.finish().error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(finger.finish().error_code(), grpc::StatusCode::UNAVAILABLE);
}

TEST(Server, ScenesSurviveItWithANewInstance) {
  const fs::path state = fs::temp_directory_path() / ("teletact-rpc-state-" + std::to_string(getpid()));
  std::uint64_t version = 0;
  std::uint64_t instance = 0;
  for (const bool again : {false, true}) {
    RunningServer server("", state);
    server->make_ready();
    v1::Scene scene;
    if (!again) {
      ASSERT_TRUE(server.create(uniform_scene("s"), "", &scene).ok());
      version = scene.version();
    }
    Toucher toucher(server.channel(), "s");
    v1::TouchOpened opened;
    ASSERT_TRUE(toucher.opened(&opened));
    v1::TouchAnswer answer;
    ASSERT_TRUE(toucher.touch(0.05, 0.002, &answer));
    EXPECT_EQ(answer.model_version(), version);
    EXPECT_NE(opened.instance(), instance);
    instance = opened.instance();
  }
  fs::remove_all(state);
}

}  // namespace
}  // namespace teletact::service
