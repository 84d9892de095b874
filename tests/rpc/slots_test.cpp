// Peers that withhold something: whatever it is, the place that they hold comes back in the stated time
// (docs/reference/limits.md), and nobody else waits for them.
#include <grpcpp/impl/codegen/client_unary_call.h>
#include <grpcpp/support/byte_buffer.h>

#include <thread>
#include <vector>

#include "tests/rpc/estimate_client.h"
#include "tests/support/finger_reader.h"

namespace teletact::service {
namespace {

using std::chrono::steady_clock;

Limits short_times() {
  Limits limits;
  limits.first_message_s = limits.acknowledge_s = limits.answer_taken_s = 0.5;
  limits.touch_idle_s = 1;
  limits.max_full_scenes = 3;
  limits.max_unary_calls = 16;
  limits.max_touch_streams = 64;  // fewer than calls of one connection
  return limits;
}

// One that lets the service send 64 KiB of what is not read, and no more.
std::shared_ptr<grpc::Channel> narrow_channel(const std::string& address) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  return grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments);
}

// Its maps are more than what a narrow channel lets pass.
v1::CreateSceneRequest large_scene() {
  constexpr int kColumns = 60, kRows = 300;
  v1::CreateSceneRequest request = uniform_scene("large");
  v1::ModulusMap* map = request.mutable_modulus();
  map->clear_x_m(), map->clear_y_m();
  for (int i = 0; i <= kColumns; ++i) map->add_x_m(0.1 * i / kColumns);
  for (int j = 0; j <= kRows; ++j) map->add_y_m(0.04 * j / kRows);
  const std::vector<float> values(kColumns * kRows, 10e3F);
  map->mutable_youngs_modulus_pa()->set_shape(0, kRows);
  map->mutable_youngs_modulus_pa()->set_shape(1, kColumns);
  map->mutable_youngs_modulus_pa()->set_data(values.data(), values.size() * sizeof(float));
  return request;
}

// A unary call of which nothing is read.
class Unread {
 public:
  Unread(const std::shared_ptr<grpc::Channel>& channel, const char* method,
         const google::protobuf::Message& request)
      : channel_(channel), method_(method, grpc::internal::RpcMethod::BIDI_STREAMING) {
    set_deadline(context_);
    stream_.reset(grpc::internal::ClientReaderWriterFactory<grpc::ByteBuffer, grpc::ByteBuffer>::Create(
        channel_.get(), method_, &context_));
    const grpc::Slice bytes(request.SerializeAsString());
    stream_->Write(grpc::ByteBuffer(&bytes, 1));
    stream_->WritesDone();
  }
  ~Unread() { context_.TryCancel(); }
  grpc::Status finish() {
    grpc::ByteBuffer answer;
    while (stream_->Read(&answer)) {
    }
    return stream_->Finish();
  }

 private:
  const std::shared_ptr<grpc::Channel> channel_;
  const grpc::internal::RpcMethod method_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<grpc::ByteBuffer, grpc::ByteBuffer>> stream_;
};

class Slots : public OnOneServer {
 protected:
  static void SetUpTestSuite() {
    serve(short_times());
    ASSERT_TRUE(server->create(large_scene()).ok());
  }
  // A watch of "s" that has said no more than that.
  struct Watch {
    explicit Watch(v1::Palpation::Stub& stub) {
      set_deadline(context);
      stream = stub.WatchFinger(&context);
      request.set_scene_id("s");
      EXPECT_TRUE(stream->Write(request));
    }
    std::uint64_t read_on() {
      std::uint64_t states = 0;
      for (v1::FingerState state; stream->Read(&state);) ++states;
      return states;
    }
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReaderWriter<v1::WatchFingerRequest, v1::FingerState>> stream;
    v1::WatchFingerRequest request;
  };
  const std::unique_ptr<v1::Palpation::Stub> stub = v1::Palpation::NewStub(channel);
};

TEST_F(Slots, StreamsThatNeverSayWhatTheyAreForEnd) {
  grpc::ClientContext touching, watching;
  set_deadline(touching), set_deadline(watching);
  const auto touch = stub->Touch(&touching);
  const auto watch = stub->WatchFinger(&watching);
  v1::TouchResponse answer;
  v1::FingerState state;
  EXPECT_FALSE(touch->Read(&answer));
  EXPECT_FALSE(watch->Read(&state));
  expect_refused(touch->Finish(), grpc::StatusCode::DEADLINE_EXCEEDED, "open");
  expect_refused(watch->Finish(), grpc::StatusCode::DEADLINE_EXCEEDED, "scene_id");
}

TEST_F(Slots, WatcherThatDoesNotAcknowledgeIsTheLeastBehindAndEnds) {
  // GIVEN a watcher of a finger that moves, which reads and says nothing
  Bystander bystander(server->channel(), "s");
  Watch watch(*stub);
  // THEN it gets one state, and its place is free again
  EXPECT_EQ(watch.read_on(), 1U);
  expect_refused(watch.stream->Finish(), grpc::StatusCode::DEADLINE_EXCEEDED, "acknowledged");
  bystander.stop();
  EXPECT_EQ(bystander.failures(), 0);
}

TEST_F(Slots, AcknowledgementsThatSayNothingNewAreNoProgress) {
  Watch watch(*stub);
  v1::FingerState state;
  ASSERT_TRUE(watch.stream->Read(&state));
  watch.request.clear_scene_id();
  while (watch.stream->Write(watch.request)) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  expect_refused(watch.stream->Finish(), grpc::StatusCode::DEADLINE_EXCEEDED, "acknowledged");
}

TEST_F(Slots, AcknowledgementsOfWhatWasNotSentEndTheWatch) {
  for (const bool named_again : {false, true}) {
    Watch watch(*stub);
    if (!named_again) watch.request.clear_scene_id();
    watch.request.set_acknowledged(77);
    watch.stream->Write(watch.request);
    watch.read_on();
    expect_refused(watch.stream->Finish(), grpc::StatusCode::INVALID_ARGUMENT,
                   named_again ? "scene_id" : "acknowledged");
  }
}

TEST_F(Slots, TouchWithoutPosesEndsWhateverElseIsSent) {
  Toucher toucher(channel, "s");
  ASSERT_TRUE(toucher.opened());
  v1::TouchRequest request;
  request.mutable_hand_over()->set_session_id("nobody");
  while (toucher.send_as_is(request)) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  expect_refused(toucher.finish(), grpc::StatusCode::DEADLINE_EXCEEDED, "no pose");
}

TEST_F(Slots, AnswersThatAreNotTakenHoldNoThreadAndAreCut) {
  // GIVEN clients that ask for whole scenes and read nothing, from connections of their own
  v1::GetSceneRequest request;
  request.set_scene_id("large");
  request.set_view(v1::SCENE_VIEW_FULL);
  Bystander bystander(server->channel(), "s");
  std::vector<std::unique_ptr<Unread>> unread;
  for (int k = 0; k < 40; ++k)
    unread.push_back(std::make_unique<Unread>(narrow_channel((*server)->address()),
                                              "/teletact.v1.Palpation/GetScene", request));
  // THEN no more than stated are held, others are served meanwhile
  while ((*server)->core().calls.count() > 1) {
    EXPECT_LE((*server)->core().calls.count(), 1 + short_times().max_full_scenes + 1);
    grpc::ClientContext context;
    set_deadline(context);
    v1::ListScenesResponse scenes;
    ASSERT_TRUE(stub->ListScenes(&context, {}, &scenes).ok());
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  bystander.stop();
  EXPECT_EQ(bystander.failures(), 0);
  // AND those beyond were refused, the others cut
  std::size_t cut = 0, refused = 0;
  for (const auto& call : unread) {
    const auto code = call->finish().error_code();
    cut += code == grpc::StatusCode::CANCELLED;
    refused += code == grpc::StatusCode::RESOURCE_EXHAUSTED;
  }
  EXPECT_EQ(cut + refused, unread.size());
  EXPECT_GE(cut, short_times().max_full_scenes);
  EXPECT_GE(refused, 1U);
}

// Silence may be idleness; poses that never acknowledge are a peer that does not read.
TEST_F(Slots, PosesThatNeverAcknowledgeAnAnswerEndTheTouch) {
  Toucher touch(channel, "s");
  ASSERT_TRUE(touch.opened());
  touch.stop_acknowledging();
  while (touch.send(0.05, 0.002)) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  std::size_t answers = 0;
  expect_refused(touch.finish(&answers), grpc::StatusCode::DEADLINE_EXCEEDED, "pose.acknowledged");
  EXPECT_EQ(answers, 1U);  // the credit
}

// GIVEN a finger that rests for longer than acknowledging may take, WHEN it goes on THEN nothing was lost.
TEST(RestingTouch, GoesOnThoughItsLastAnswerIsUnacknowledged) {
  Limits limits;
  limits.acknowledge_s = 0.1;
  RunningServer server("", "", limits);
  server->make_ready();
  ASSERT_TRUE(server.create(uniform_scene("s")).ok());
  Toucher touch(server.channel(), "s");
  ASSERT_TRUE(touch.opened());
  v1::TouchAnswer answer;
  ASSERT_TRUE(touch.touch(0.05, 0.002, &answer));
  for (int k = 0; k < 2; ++k) {
    std::this_thread::sleep_for(std::chrono::milliseconds(140));
    ASSERT_TRUE(touch.touch(0.05, 0.002, &answer));
  }
  EXPECT_TRUE(touch.finish().ok());
}

class Floods : public OnOneServer {};

// At once at most what a tenth of a second allows; the others as the rate does, whatever else the machine has
// to do.
TEST_F(Floods, PosesAreReadNoFasterThanTwiceTheTouchRate) {
  constexpr int kPoses = 1000;
  const double rate_hz = 2 * Limits{}.max_touch_rate_hz, at_once = 0.1 * rate_hz;
  Toucher flood(channel, "s");
  ASSERT_TRUE(flood.opened());
  flood.stop_acknowledging();
  const auto begun = steady_clock::now();
  v1::TouchRequest request;
  for (const double v : {0.05, 0.002}) request.mutable_pose()->add_position_m(v);
  for (std::uint64_t k = 1; k <= kPoses; ++k) {
    request.mutable_pose()->set_sequence(k);
    ASSERT_TRUE(flood.send_as_is(request));
  }
  EXPECT_TRUE(flood.finish().ok());  // once all of them are read
  const std::chrono::duration<double> took = steady_clock::now() - begun;
  EXPECT_GE(took.count(), (kPoses - at_once) / rate_hz);
}

TEST_F(Slots, OthersAreServedWhileOneFillsAllPlacesOfItsKind) {
  std::vector<std::unique_ptr<grpc::ClientContext>> contexts;
  std::vector<std::unique_ptr<grpc::ClientReaderWriter<v1::TouchRequest, v1::TouchResponse>>> silent;
  for (std::uint64_t k = 0; k < short_times().max_touch_streams; ++k) {
    contexts.push_back(std::make_unique<grpc::ClientContext>());
    set_deadline(*contexts.back());
    silent.push_back(stub->Touch(contexts.back().get()));
  }
  // A client that tries again is served as soon as their time is up.
  bool served = false;
  for (int attempt = 0; attempt < 2000 && !served; ++attempt) {
    Toucher toucher(server->channel(), "s");
    v1::TouchAnswer answer;
    served = attempt > 0 && toucher.opened() && toucher.touch(0.05, 0.002, &answer);
    if (!served) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_TRUE(served);
  v1::TouchResponse response;
  for (const auto& stream : silent) {
    EXPECT_FALSE(stream->Read(&response));
    EXPECT_NE(stream->Finish().error_code(), grpc::StatusCode::OK);
  }
}

}  // namespace
}  // namespace teletact::service
