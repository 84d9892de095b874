// Several fingers on one scene: one of them is followed, and all are told which (scene/finger.h).
#include <optional>

#include "tests/rpc/running_server.h"
#include "tests/support/finger_reader.h"

namespace teletact::service {
namespace {

v1::TouchOpen open_as(const std::string& session_id) {
  v1::TouchOpen open = Toucher::open_on("s");
  open.set_session_id(session_id);
  return open;
}

class Steering : public OnOneServer {
 protected:
  struct Hand : Toucher {
    explicit Hand(const std::string& name) : Toucher(server->channel(), open_as(name)) {
      EXPECT_TRUE(Toucher::opened(&welcome));
    }
    v1::TouchAnswer touch_at(double x_m) {
      v1::TouchAnswer answer;
      EXPECT_TRUE(touch(x_m, 0.002, &answer));
      return answer;
    }
    void hand_over_to(const std::string& name) {
      v1::TouchRequest request;
      request.mutable_hand_over()->set_session_id(name);
      EXPECT_TRUE(send_as_is(request));
    }
    v1::TouchOpened welcome;
  };
  struct Watcher {
    Watcher() : stub(v1::Palpation::NewStub(server->channel())) {
      set_deadline(context);
      reader.emplace(*stub, context, "s");
    }
    ~Watcher() { context.TryCancel(); }
    // Reads on until `wanted`; every state meanwhile must be of a stream that steered.
    template <class Wanted>
    v1::FingerState until(Wanted wanted) {
      v1::FingerState state;
      do EXPECT_TRUE(reader->read(&state));
      while (!HasFailure() && !wanted(state));
      return state;
    }
    std::unique_ptr<v1::Palpation::Stub> stub;
    grpc::ClientContext context;
    std::optional<FingerReader> reader;
  };
};

TEST_F(Steering, OneOfTwoFingersIsFollowedAndBothAreTold) {
  // GIVEN two hands on a scene, and the patient side
  Hand anna("anna"), berta("berta");
  Watcher watcher;
  EXPECT_TRUE(anna.welcome.steers());
  EXPECT_EQ(anna.welcome.steered_by(), "anna");
  EXPECT_FALSE(berta.welcome.steers());
  EXPECT_EQ(berta.welcome.steered_by(), "anna");
  // WHEN both move
  for (int k = 0; k < 40; ++k) {
    const v1::TouchAnswer of_anna = anna.touch_at(0.02 + 1e-4 * k), of_berta = berta.touch_at(0.08);
    // THEN both feel, and know who steers
    EXPECT_EQ(of_anna.status(), v1::TOUCH_STATUS_OK);
    EXPECT_EQ(of_berta.status(), v1::TOUCH_STATUS_OK);
    EXPECT_TRUE(of_anna.steers());
    EXPECT_FALSE(of_berta.steers());
    EXPECT_EQ(of_berta.steered_by(), "anna");
    // AND only the one is followed
    const v1::FingerState state = watcher.until([](const auto& s) { return s.position_m_size() > 0; });
    EXPECT_LT(state.position_m(0), 0.05);
    EXPECT_EQ(state.session_id(), "anna");
  }
}

TEST_F(Steering, EndOfTheStreamThatSteersPassesItOn) {
  std::optional<Hand> anna(std::in_place, "anna");
  Hand berta("berta");
  Watcher watcher;
  anna->touch_at(0.02), berta.touch_at(0.08);
  EXPECT_TRUE(anna->finish().ok());
  watcher.until([](const auto& s) { return s.session_id() == "berta"; });
  EXPECT_TRUE(berta.touch_at(0.081).steers());
  const v1::FingerState state = watcher.until([](const auto& s) { return s.position_m(0) != 0.02; });
  EXPECT_EQ(state.position_m(0), 0.081);
  EXPECT_TRUE(berta.finish().ok());
  watcher.until([](const auto& s) { return !s.present() && s.session_id().empty(); });
}

TEST_F(Steering, IsHandedOverAndBack) {
  Hand anna("anna"), berta("berta"), carla("carla");
  anna.hand_over_to("carla");
  EXPECT_FALSE(anna.touch_at(0.02).steers());
  EXPECT_EQ(berta.touch_at(0.05).steered_by(), "carla");
  EXPECT_TRUE(carla.touch_at(0.08).steers());
  berta.hand_over_to("berta");  // not hers to give
  EXPECT_EQ(berta.touch_at(0.05).steered_by(), "carla");
  carla.hand_over_to("anna");
  EXPECT_EQ(carla.touch_at(0.08).steered_by(), "anna");
  EXPECT_TRUE(anna.touch_at(0.02).steers());
}

TEST_F(Steering, LapsesWhenTheHandFallsSilent) {
  // GIVEN one that steers and then says nothing, and one that touches
  Hand anna("anna"), berta("berta");
  anna.touch_at(0.02);
  const auto begun = std::chrono::steady_clock::now();
  // WHEN that goes on
  while (!berta.touch_at(0.08).steers() && !HasFailure()) {
  }
  // THEN the other one steers after 2 s, not before
  EXPECT_GT(std::chrono::steady_clock::now() - begun, FingerBoard::kLease - std::chrono::milliseconds(200));
  EXPECT_EQ(anna.touch_at(0.02).steered_by(), "berta");
}

TEST_F(Steering, HandOverBeforeOpenAndNamesThatAreTooLongAreRefused) {
  const std::string longest(64, 'a');
  EXPECT_EQ(Hand(longest).welcome.steered_by(), longest);
  Toucher too_long(channel, open_as(longest + "a"));
  expect_refused(too_long.finish(), grpc::StatusCode::INVALID_ARGUMENT, "open.session_id");
  grpc::ClientContext context;
  set_deadline(context);
  const auto stub = v1::Palpation::NewStub(channel);
  const auto stream = stub->Touch(&context);
  v1::TouchRequest request;
  request.mutable_hand_over()->set_session_id("anna");
  stream->Write(request);
  v1::TouchResponse response;
  EXPECT_FALSE(stream->Read(&response));
  EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

}  // namespace
}  // namespace teletact::service
