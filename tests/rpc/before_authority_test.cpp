// Peers that have not shown who they are: what they cost is bounded, and others feel nothing of it.
#include <malloc.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <string>
#include <vector>

#include "tests/access/access_folder.h"
#include "tests/rpc/estimate_client.h"
#include "tests/rpc/guarded_server.h"
#include "tests/rpc/health.h"
#include "tests/rpc/http2_peer.h"
#include "tests/rpc/running_server.h"

namespace teletact::service {
namespace {

using std::chrono::steady_clock;

std::size_t heap_bytes() {
  const auto heap = mallinfo2();
  return heap.uordblks + heap.hblkhd;
}

grpc::Status get_info(const std::shared_ptr<grpc::Channel>& channel, bool compressed = false,
                      const std::string& token = "") {
  grpc::ClientContext context;
  set_deadline(context);
  context.set_wait_for_ready(token.empty());
  if (!token.empty()) context.AddMetadata("authorization", "Bearer " + token);
  if (compressed) context.set_compression_algorithm(GRPC_COMPRESS_GZIP);
  v1::GetInfoResponse info;
  return v1::Info::NewStub(channel)->GetInfo(&context, {}, &info);
}

// That its connection is closed before gRPC would close it: it answers no ping for 15 s.
bool ends(Http2Peer& peer) {
  for (int k = 0; k < 50; ++k)
    if (!peer.receive(200)) return true;
  return false;
}

// On TCP: whoever reaches a Unix socket may use this machine.
class BeforeAuthority : public testing::Test {
 protected:
  explicit BeforeAuthority(const Limits& limits = {}, const ConnectionLimits& connections = {})
      : server("127.0.0.1:0", "", limits, tissue_models(), {}, false, {}, connections) {
    server->make_ready();
    EXPECT_TRUE(server.create(uniform_scene("s")).ok());
  }
  std::string address() { return server->address(); }
  // A peer makes calls until it is cut: the most bytes that the heap grows by meanwhile.
  std::size_t growth_until_cut(const std::function<std::string(std::uint32_t stream)>& call) {
    constexpr std::uint32_t kMaxCalls = 60'000, kAtOnce = 100;
    Http2Peer peer(address());
    const std::size_t before = heap_bytes();
    std::size_t most = before;
    std::uint32_t calls = 0;
    for (bool there = true; there && calls < kMaxCalls; calls += kAtOnce) {
      std::string bytes;
      for (std::uint32_t k = calls; k < calls + kAtOnce; ++k) bytes += call(2 * k + 1);
      there = peer.send(bytes) && peer.receive();
      most = std::max(most, heap_bytes());
    }
    EXPECT_LT(calls, kMaxCalls) << "it goes on";
    return most - before;
  }
  RunningServer server;
};

// Far more than a touch takes on a busy machine, and far less than it took before: 8 to 21 s.
constexpr double kUnmovedS = 2;

class Resets : public BeforeAuthority, public testing::WithParamInterface<const char*> {};

TEST_P(Resets, CutTheirConnectionAndLeaveNothing) {
  Bystander bystander(server.channel(), "s");
  const auto call = [](std::uint32_t stream) {
    return Http2Peer::call(stream, GetParam()) + Http2Peer::reset(stream);
  };
  EXPECT_LT(growth_until_cut(call), std::size_t{256} << 20);
  bystander.stop();
  EXPECT_EQ(bystander.failures(), 0);
  EXPECT_LT(bystander.latency_s(1), kUnmovedS);
  server.expect_all_calls_end();
}

INSTANTIATE_TEST_SUITE_P(Of, Resets,
                         testing::Values("/teletact.v1.Info/GetInfo", "/teletact.v1.Palpation/Touch",
                                         "/grpc.health.v1.Health/Watch",
                                         "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"),
                         [](const auto& method) {
                           const std::string path = method.param;
                           return path.substr(path.rfind('/') + 1);
                         });

// gRPC holds a peer that confirms no settings to no number of them, and tells nobody before a message has
// come.
TEST_F(BeforeAuthority, CallsThatWaitForTheirMessageCutTheConnection) {
  const auto call = [](std::uint32_t stream) {
    return Http2Peer::call(stream, "/grpc.health.v1.Health/Check");
  };
  EXPECT_LT(growth_until_cut(call), std::size_t{350} << 20);
}

// Frames of a type that there is not: HTTP/2 has them ignored.
TEST_F(BeforeAuthority, BytesThatAreNoCallsCutTheConnection) {
  constexpr auto kNoSuchType = static_cast<Http2Peer::Type>(0xf0);
  const std::string frame = Http2Peer::frame(kNoSuchType, 0, 0, std::string(16384, 'x'));
  Http2Peer peer(address());
  int frames = 0;
  while (frames < 4096 && peer.send(frame) && peer.receive()) ++frames;
  EXPECT_LT(frames, 4096);
  EXPECT_TRUE(get_info(server.channel()).ok());
}

class FewUnknown : public BeforeAuthority {
 protected:
  static constexpr std::size_t kMax = 16;
  FewUnknown() : BeforeAuthority({}, limits()) {}
  static ConnectionLimits limits() {
    ConnectionLimits limits;
    limits.max_unknown = kMax;
    limits.min_for_showing = std::chrono::milliseconds(20);
    return limits;
  }
};

TEST_F(FewUnknown, IdleConnectionsGiveWay) {
  std::vector<Http2Peer> idle;
  for (std::size_t k = 0; k < 2 * kMax; ++k) idle.emplace_back(address());
  const auto channel = server.channel();
  EXPECT_TRUE(get_info(channel).ok());
  EXPECT_LE(server->core().connections.count(), kMax + 3);
  EXPECT_FALSE(idle.front().receive(10'000) && idle.front().receive(10'000)) << "the oldest stays";
  // One that has shown who it is stays.
  for (std::size_t k = 0; k < kMax; ++k) idle.emplace_back(address());
  EXPECT_TRUE(get_info(channel).ok());
}

// Who is alone behind its host goes last.
TEST_F(FewUnknown, TheHostThatHasMostGivesWay) {
  Http2Peer alone(address(), "", 2);
  std::vector<Http2Peer> many;
  for (std::size_t k = 0; k < 3 * kMax; ++k) many.emplace_back(address());
  EXPECT_TRUE(get_info(server.channel()).ok());
  EXPECT_TRUE(alone.receive());
  EXPECT_TRUE(ends(many.front()));
}

class Crowd : public BeforeAuthority {
 protected:
  Crowd() : BeforeAuthority({}, limits()) {}
  static ConnectionLimits limits() {
    ConnectionLimits limits;
    limits.max_unknown = 4;
    limits.min_for_showing = std::chrono::minutes(1);
    return limits;
  }
};

TEST_F(Crowd, GivesWayFaster) {
  std::vector<Http2Peer> idle;
  for (int k = 0; k < 100; ++k) idle.emplace_back(address());
  EXPECT_TRUE(ends(idle.front()));
}

class Together : public BeforeAuthority {
 protected:
  static constexpr int kCalls = 100, kPeers = 8;
  static constexpr std::size_t kBytes = 128 << 10;
  Together() : BeforeAuthority({}, limits()) {}
  static ConnectionLimits limits() {
    ConnectionLimits limits;
    limits.unknown_calls = Allowance(kCalls, 1);
    limits.unknown_bytes = Allowance(kBytes, 1);
    return limits;
  }
  // Each sends this. One that has sent no more than a first call takes stays.
  void expect_cut(const std::string& bytes) {
    Http2Peer modest(address());
    std::vector<Http2Peer> peers;
    for (int k = 0; k < kPeers; ++k) peers.emplace_back(address());
    for (Http2Peer& peer : peers) peer.send(bytes);
    EXPECT_TRUE(ends(peers.front()));
    EXPECT_TRUE(modest.receive());
  }
  static std::string some(std::size_t bytes) {  // of a type of frame that there is not
    constexpr auto kNoSuchType = static_cast<Http2Peer::Type>(0xf0);
    return Http2Peer::frame(kNoSuchType, 0, 0, std::string(bytes, 'x'));
  }
};

// Each of them fewer than one may. They wait for their message, and nobody is told of them.
TEST_F(Together, CallsCutWhoHasSentMost) {
  std::string calls;
  for (std::uint32_t k = 0; k < kCalls / 2; ++k)
    calls +=
        Http2Peer::call(2 * k + 1, "/teletact.v1.Info/GetInfo", {{"x-long", "100 bytes a call, and more"}});
  ASSERT_GT(calls.size(), limits().first_call_bytes);
  expect_cut(calls);
}

TEST_F(Together, BytesCutWhoHasSentMost) {
  expect_cut(some(kBytes / 8) + some(kBytes / 8));
}

TEST_F(Together, CallsOfWhoIsKnownAreNotCounted) {
  const auto channel = server.channel();
  EXPECT_TRUE(get_info(channel).ok());
  Http2Peer peer(address());
  peer.send(some(2 * limits().first_call_bytes));
  for (int k = 0; k < 3 * kCalls; ++k) ASSERT_TRUE(get_info(channel).ok());
  EXPECT_TRUE(peer.receive(100));
}

class Alone : public BeforeAuthority {
 protected:
  Alone() : BeforeAuthority(small(), limits()) {}
  static Limits small() {  // messages: a connection may send two of the largest
    Limits small;
    small.max_scene_elements = 20'000;
    return small;
  }
  static ConnectionLimits limits() {  // of one connection: all together have no limit
    ConnectionLimits limits;
    limits.unknown_bytes = Allowance(1e12, 1);
    limits.unknown_window_bytes = 1 << 20;
    return limits;
  }
};

TEST_F(Alone, WhoSendsForEverIsCut) {
  const auto nothing = Http2Peer::frame(static_cast<Http2Peer::Type>(0xf0), 0, 0, std::string(16 << 10, 'x'));
  Http2Peer peer(address());
  bool there = true;
  const auto patience = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  while (there && std::chrono::steady_clock::now() < patience) there = peer.send(nothing);
  EXPECT_FALSE(there) << "it goes on";
}

TEST_F(BeforeAuthority, CompressedMessagesAreRefused) {
  const auto channel = server.channel();
  EXPECT_TRUE(get_info(channel).ok());
  EXPECT_EQ(get_info(channel, true).error_code(), grpc::StatusCode::UNIMPLEMENTED);
  struct Compressed {
    std::shared_ptr<grpc::Channel> channel() const {
      grpc::ChannelArguments arguments;
      arguments.SetCompressionAlgorithm(how);
      return grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments);
    }
    std::string address;
    grpc_compression_algorithm how;
  };
  const std::string all_alike(100, 'x');  // what does not shrink is sent as it is
  for (const auto how : {GRPC_COMPRESS_GZIP, GRPC_COMPRESS_DEFLATE})
    EXPECT_EQ(health_of(Compressed{address(), how}, all_alike), -grpc::StatusCode::UNIMPLEMENTED) << how;
}

// By a peer that has not confirmed what it was told.
TEST_F(BeforeAuthority, HeadersLongerThanAnnouncedAreRefused) {
  for (const std::size_t bytes : {std::size_t{100}, std::size_t{1} << 20}) {
    Http2Peer peer(address());
    peer.send(Http2Peer::call(1, "/teletact.v1.Info/GetInfo", {{"x-long", std::string(bytes, 'x')}}) +
              Http2Peer::message(1, "", true));
    const auto begun = steady_clock::now();
    while (peer.received().find("grpc-status") == std::string::npos && peer.receive(1000) &&
           steady_clock::now() - begun < std::chrono::seconds(30))
      continue;
    const bool served = peer.received().find("max_frame_bytes") != std::string::npos;
    EXPECT_EQ(served, bytes < 8192) << bytes;
  }
}

class ShortPatience : public BeforeAuthority {
 protected:
  ShortPatience() : BeforeAuthority(limits()) {}
  static Limits limits() {
    Limits limits;
    limits.acknowledge_s = 0.1;
    limits.max_touch_streams = 8;
    return limits;
  }
};

TEST_F(ShortPatience, TouchThatTakesNothingEndsWhateverItSends) {
  constexpr std::uint16_t kInitialWindow = 4;
  v1::TouchRequest open, pose;
  open.mutable_open()->set_scene_id("s");
  for (const double v : {0.05, 0.002}) pose.mutable_pose()->add_position_m(v);
  Http2Peer peer(address(), Http2Peer::setting(kInitialWindow, 0));
  peer.send(Http2Peer::call(1, "/teletact.v1.Palpation/Touch") +
            Http2Peer::message(1, open.SerializeAsString(), false));
  const auto touches = [this] { return server->core().calls.count(CallKind::kTouch); };
  while (touches() == 0) std::this_thread::yield();
  const auto begun = steady_clock::now();
  for (std::uint64_t k = 1; touches() > 0; ++k) {
    ASSERT_LT(steady_clock::now() - begun, std::chrono::seconds(60)) << "it holds its place";
    pose.mutable_pose()->set_sequence(k);
    peer.send(Http2Peer::message(1, pose.SerializeAsString(), false));
    peer.receive(20);
  }
}

TEST_F(ShortPatience, OneClientDoesNotTakeAllPlacesForTouch) {
  const auto stub = v1::Palpation::NewStub(server.channel());
  struct Touch {
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReaderWriter<v1::TouchRequest, v1::TouchResponse>> stream;
    ~Touch() { context.TryCancel(); }
  };
  std::vector<std::unique_ptr<Touch>> touches;
  const auto open = [&](const char* client) {
    auto& touch = *touches.emplace_back(std::make_unique<Touch>());
    set_deadline(touch.context);
    touch.context.AddMetadata("teletact-client", client);
    touch.stream = stub->Touch(&touch.context);
    v1::TouchRequest request;
    request.mutable_open()->set_scene_id("s");
    touch.stream->Write(request);
    v1::TouchResponse opened;
    return touch.stream->Read(&opened);
  };
  for (std::uint64_t k = 0; k < limits().max_touch_streams / 2; ++k) ASSERT_TRUE(open("greedy")) << k;
  EXPECT_FALSE(open("greedy"));
  expect_refused(touches.back()->stream->Finish(), grpc::StatusCode::RESOURCE_EXHAUSTED, "this client's");
  EXPECT_TRUE(open("modest"));
}

// Who tries one token after the other, however slowly a busy machine lets it.
TEST(UnknownCallers, AreCut) {
  ConnectionLimits limits;
  limits.wasted = Allowance(10, 10);
  GuardedServer server(Transport::kTls, entry_of("anna", "operator"), limits);
  const auto channel = server.channel();
  grpc::Status status;
  int calls = 0;
  for (; calls < 20'000; ++calls) {
    status = get_info(channel, false, "guess-" + std::to_string(calls));
    if (status.error_code() != grpc::StatusCode::UNAUTHENTICATED) break;
  }
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE) << status.error_message();
  EXPECT_GE(calls, 100) << "one that mistypes";
}

}  // namespace
}  // namespace teletact::service
