// Touch streams: what is answered, what is refused, and what ends them.
#include <cmath>
#include <vector>

#include "tests/rpc/estimate_client.h"
#include "tests/support/finger_reader.h"

namespace teletact::service {
namespace {

using Palpation = OnOneServer;

TEST_F(Palpation, AnswerCarriesThePoseItBelongsTo) {
  v1::TouchOpen open = Toucher::open_on("s");
  open.set_pressure(true);
  Toucher toucher(channel, open);
  v1::TouchOpened opened;
  ASSERT_TRUE(toucher.opened(&opened));
  EXPECT_EQ(opened.credit(), 1U);
  EXPECT_NEAR(opened.period_s(), 0.001, 1e-9);
  v1::TouchRequest request;
  request.mutable_pose()->set_sequence(41);
  request.mutable_pose()->mutable_stamp()->set_monotonic_ns(12345);
  request.mutable_pose()->mutable_stamp()->set_instance(67);
  request.mutable_pose()->add_position_m(0.05);
  request.mutable_pose()->add_position_m(0.003);
  ASSERT_TRUE(toucher.send(request));
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.read(&answer));
  EXPECT_EQ(answer.sequence(), 41U);
  EXPECT_EQ(answer.answer(), 1U);
  EXPECT_EQ(answer.pose_stamp().monotonic_ns(), 12345);
  EXPECT_EQ(answer.pose_stamp().instance(), 67U);
  ASSERT_EQ(answer.position_m_size(), 2);
  EXPECT_EQ(answer.position_m(1), 0.003);
  EXPECT_EQ(answer.status(), v1::TOUCH_STATUS_OK);
  EXPECT_EQ(answer.path(), v1::SOLVE_PATH_COMPLIANCE);
  ASSERT_EQ(answer.force_n_size(), 3);
  EXPECT_LT(answer.force_n(1), -0.05);
  ASSERT_EQ(answer.tangent_n_m_size(), 9);
  EXPECT_LT(answer.tangent_n_m(4), 0);
  EXPECT_EQ(answer.tangent_n_m(1), answer.tangent_n_m(3));
  EXPECT_GT(answer.pressure_size(), 2);
  for (const v1::NodalPressure& node : answer.pressure()) {
    ASSERT_EQ(node.position_m_size(), 3);
    EXPECT_NEAR(node.position_m(0), 0.05, 0.015);
    EXPECT_EQ(node.position_m(1), 0);
    EXPECT_EQ(node.traction_pa_size(), 3);
  }
  ASSERT_EQ(opened.layer().normal_size(), 3);
  EXPECT_EQ(opened.layer().normal(1), 1);
  EXPECT_NEAR(answer.covered().end_x_m(), 0.1, 1e-12);
  EXPECT_FALSE(answer.covered().has_end_z_m());
  EXPECT_GT(answer.compute_ns(), 0);
  EXPECT_GE(answer.queued_ns(), 0);
  EXPECT_GT(answer.model_version(), 0U);
  EXPECT_EQ(answer.answer_stamp().instance(), opened.instance());
  EXPECT_EQ(answer.model_stamp().instance(), opened.instance());
  EXPECT_GT(answer.model_stamp().monotonic_ns(), 0);
  EXPECT_LT(answer.model_stamp().monotonic_ns(), answer.answer_stamp().monotonic_ns());
  EXPECT_TRUE(toucher.finish().ok());
}

TEST_F(Palpation, PressureIsSentOnRequestAlone) {
  Toucher toucher(channel, "s");
  ASSERT_TRUE(toucher.opened());
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.touch(0.05, 0.003, &answer));
  EXPECT_LT(answer.force_n(1), -0.05);
  EXPECT_EQ(answer.pressure_size(), 0);
  EXPECT_LE(answer.ByteSizeLong(), 400U);
}

TEST_F(Palpation, ForceIsTheWorkThatThePoseDoes) {
  Toucher toucher(channel, "s");
  ASSERT_TRUE(toucher.opened());
  v1::TouchAnswer before, after, middle;
  const double step_m = 1e-5;
  ASSERT_TRUE(toucher.touch(0.0503, 0.003 - step_m, &before));
  ASSERT_TRUE(toucher.touch(0.0503, 0.003 + step_m, &after));
  ASSERT_TRUE(toucher.touch(0.0503, 0.003, &middle));
  const double slope = (after.energy_j() - before.energy_j()) / (2 * step_m);
  EXPECT_NEAR(middle.force_n(1), -slope, 1e-3 * std::abs(slope));
}

TEST_F(Palpation, GradientsGiveTheSameForceByRequest) {
  v1::TouchOpen open = Toucher::open_on("s");
  open.set_path(v1::SOLVE_PATH_GRADIENTS);
  Toucher by_gradients(server->channel(), open), by_compliance(channel, "s");
  ASSERT_TRUE(by_gradients.opened() && by_compliance.opened());
  v1::TouchAnswer pcg, compliance;
  do {  // a busy machine solves the columns of the contact in several goes, and says so
    ASSERT_TRUE(by_gradients.touch(0.0503, 0.002, &pcg));
  } while (pcg.warning().find("being solved") != std::string::npos);
  ASSERT_TRUE(by_compliance.touch(0.0503, 0.002, &compliance));
  EXPECT_EQ(pcg.path(), v1::SOLVE_PATH_GRADIENTS) << pcg.warning();
  EXPECT_GT(pcg.solve().iterations(), 0U);
  EXPECT_NEAR(pcg.force_n(1), compliance.force_n(1), 2e-3 * std::abs(compliance.force_n(1)));
}

// Its first answers come while it is made elsewhere, and say so.
TEST_F(Palpation, InteriorLayerIsPreparedBeforeItHasAForce) {
  v1::TouchOpen open = Toucher::open_on("s");
  open.mutable_layer()->set_depth_m(0.02);
  Toucher toucher(channel, open);
  v1::TouchOpened opened;
  ASSERT_TRUE(toucher.opened(&opened));
  v1::TouchAnswer first, ready;
  ASSERT_TRUE(toucher.send(0.05, opened.layer().depth_m() + 0.002) && toucher.read(&first));
  EXPECT_EQ(first.status(), v1::TOUCH_STATUS_PREPARING);
  EXPECT_EQ(first.force_n(1), 0);
  EXPECT_NE(first.warning(), "");
  ASSERT_TRUE(toucher.touch(0.05, opened.layer().depth_m() + 0.002, &ready));
  EXPECT_EQ(ready.status(), v1::TOUCH_STATUS_OK) << ready.warning();
  EXPECT_LT(ready.force_n(1), 0);
}

TEST_F(Palpation, SilentReaderGetsNoMoreThanItsCredit) {
  v1::TouchOpen open = Toucher::open_on("s");
  open.set_credit(3);
  Toucher toucher(channel, open);
  ASSERT_TRUE(toucher.opened());
  toucher.stop_acknowledging();
  v1::TouchAnswer answer;
  for (int k = 0; k < 3; ++k) ASSERT_TRUE(toucher.touch(0.05, 0.001 + 1e-6 * k, &answer));
  for (int k = 0; k < 500; ++k) ASSERT_TRUE(toucher.send(0.05, 0.002));
  ASSERT_TRUE(toucher.send(0.05, 0.0031));
  std::size_t unread = 0;
  EXPECT_TRUE(toucher.finish(&unread).ok());
  EXPECT_EQ(unread, 0U);
}

TEST_F(Palpation, NewestPoseWins) {
  Toucher toucher(channel, "s");
  ASSERT_TRUE(toucher.opened());
  toucher.stop_acknowledging();
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.touch(0.05, 0.001, &answer));  // uses up the credit
  for (int k = 0; k < 200; ++k) ASSERT_TRUE(toucher.send(0.05, 0.001 + 1e-5 * k));
  v1::TouchRequest last;
  last.mutable_pose()->set_sequence(10000);
  last.mutable_pose()->add_position_m(0.05);
  last.mutable_pose()->add_position_m(0.0035);
  last.mutable_pose()->set_acknowledged(1);
  toucher.send_as_is(last);  // acknowledges
  ASSERT_TRUE(toucher.read(&answer));
  EXPECT_EQ(answer.sequence(), 10000U);
  EXPECT_EQ(answer.position_m(1), 0.0035);
}

TEST_F(Palpation, SenselessPosesEndTheirStreamAlone) {
  Toucher bystander(server->channel(), "s");
  ASSERT_TRUE(bystander.opened());
  struct Bad {
    std::vector<double> position_m, velocity_m_s;
    std::uint64_t sequence, acknowledged;
    const char* field;
  };
  for (const Bad& bad :
       {Bad{{kNan, 0.001}, {}, 1, 0, "pose.position_m[0]"},
        Bad{{0.05, HUGE_VAL}, {}, 1, 0, "pose.position_m[1]"}, Bad{{0.05}, {}, 1, 0, "pose.position_m"},
        Bad{{}, {}, 1, 0, "pose.position_m"}, Bad{{1, 2, 3, 4}, {}, 1, 0, "pose.position_m"},
        Bad{{0.05, 0.001}, {kNan, 0}, 1, 0, "pose.velocity_m_s[0]"},
        Bad{{0.05, 0.001}, {}, 0, 0, "pose.sequence"}, Bad{{0.05, 0.001}, {}, 1, 99, "pose.acknowledged"}}) {
    Toucher toucher(channel, "s");
    ASSERT_TRUE(toucher.opened());
    v1::TouchRequest request;
    v1::ContactPose* pose = request.mutable_pose();
    pose->mutable_position_m()->Add(bad.position_m.begin(), bad.position_m.end());
    pose->mutable_velocity_m_s()->Add(bad.velocity_m_s.begin(), bad.velocity_m_s.end());
    pose->set_sequence(bad.sequence);
    pose->set_acknowledged(bad.acknowledged);
    toucher.send_as_is(request);
    expect_refused(toucher.finish(), grpc::StatusCode::INVALID_ARGUMENT, bad.field);
    v1::TouchAnswer answer;
    ASSERT_TRUE(bystander.touch(0.05, 0.002, &answer));
    EXPECT_EQ(answer.status(), v1::TOUCH_STATUS_OK);
  }
}

TEST_F(Palpation, FingerThatLeavesTheTissueIsAnsweredAndComesBack) {
  // GIVEN a finger that is felt
  Toucher toucher(channel, "s");
  ASSERT_TRUE(toucher.opened());
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.touch(0.05, 0.003, &answer));
  const double force_n = answer.force_n(1);
  EXPECT_LT(force_n, 0);
  // WHEN it is beside the tissue, or deeper than it
  const std::vector<std::pair<double, double>> beside{
      {-0.001, 0.001}, {-1e300, -1e300}, {0.1001, 0.001}, {1e9, 0.001}},
      deeper{{0.05, 0.04}, {0.05, 1e9}};
  for (const auto& [poses, field] : {std::pair{beside, "position_m[0]"}, std::pair{deeper, "position_m[1]"}})
    for (const auto& [x_m, y_m] : poses) {
      ASSERT_TRUE(toucher.touch(x_m, y_m, &answer)) << x_m << " " << y_m;
      // THEN that is an answer
      EXPECT_EQ(answer.status(), v1::TOUCH_STATUS_NOT_COVERED);
      EXPECT_NE(answer.warning().find(field), std::string::npos) << answer.warning();
      for (const double f : answer.force_n()) EXPECT_EQ(f, 0);
      for (const double k : answer.tangent_n_m()) EXPECT_EQ(k, 0);
      EXPECT_EQ(answer.energy_j(), 0);
      EXPECT_FALSE(answer.has_foreseen());
    }
  // AND back on it the finger feels what it felt
  ASSERT_TRUE(toucher.touch(0.05, 0.003, &answer));
  EXPECT_EQ(answer.status(), v1::TOUCH_STATUS_OK);
  EXPECT_EQ(answer.force_n(1), force_n);
  EXPECT_TRUE(toucher.finish().ok());
}

TEST_F(Palpation, OpensThatMakeNoSenseAreNamed) {
  Bystander bystander(server->channel(), "s");
  const auto refused = [&](grpc::StatusCode code, const char* field, auto change) {
    v1::TouchOpen open = Toucher::open_on("s");
    change(open);
    Toucher toucher(channel, open);
    expect_refused(toucher.finish(), code, field);
  };
  using enum grpc::StatusCode;
  for (const std::vector<double>& normal :
       std::vector<std::vector<double>>{{1, 0, 0}, {0, -1, 0}, {0, NAN, 0}, {0, 0, 0}, {1}, {0, 1, 0, 0}})
    refused(INVALID_ARGUMENT, "open.layer.normal", [&](v1::TouchOpen& open) {
      open.mutable_layer()->mutable_normal()->Add(normal.begin(), normal.end());
    });
  refused(NOT_FOUND, "scene_id", [](auto& o) { o.set_scene_id("nowhere"); });
  // Longer than a status may be: what is shown of it is cut, so that the message arrives.
  refused(NOT_FOUND, "scene_id", [](auto& o) { o.set_scene_id(std::string(1 << 20, '\n')); });
  refused(INVALID_ARGUMENT, "open.credit", [](auto& o) { o.set_credit(257); });
  refused(INVALID_ARGUMENT, "open.credit", [](auto& o) { o.set_credit(1'000'000'000); });
  refused(INVALID_ARGUMENT, "open.period_s", [](auto& o) { o.set_period_s(-1); });
  refused(INVALID_ARGUMENT, "open.period_s", [](auto& o) { o.set_period_s(kNan); });
  for (const double depth_m : {0.04, kNan})
    refused(INVALID_ARGUMENT, "open.layer.depth_m",
            [&](auto& o) { o.mutable_layer()->set_depth_m(depth_m); });
  refused(INVALID_ARGUMENT,
          "open.fingertip.radius_m: 0.5 m is not within [0.0001, 0.014]; a fingertip has about 0.008 m",
          [](auto& o) { o.mutable_fingertip()->set_radius_m(0.5); });
  refused(INVALID_ARGUMENT, "open.fingertip.shape",
          [](auto& o) { o.mutable_fingertip()->set_shape(static_cast<v1::FingertipShape>(77)); });
  v1::TouchOpen open = Toucher::open_on("s");
  Toucher twice(channel, open);
  v1::TouchRequest again;
  *again.mutable_open() = open;
  twice.send_as_is(again);
  expect_refused(twice.finish(), INVALID_ARGUMENT, "open");
  bystander.stop();
  EXPECT_EQ(bystander.failures(), 0);
  EXPECT_GT(bystander.answers(), 0U);
}

TEST_F(Palpation, PoseBeforeOpenIsRefused) {
  grpc::ClientContext context;
  set_deadline(context);
  const auto stub = v1::Palpation::NewStub(channel);
  const auto stream = stub->Touch(&context);
  v1::TouchRequest request;
  request.mutable_pose()->set_sequence(1);
  stream->Write(request);
  v1::TouchResponse response;
  EXPECT_FALSE(stream->Read(&response));
  EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(Palpation, FingerIsWatched) {
  ASSERT_TRUE(server->create(uniform_scene("watched")).ok());
  Toucher toucher(channel, "watched");
  ASSERT_TRUE(toucher.opened());
  grpc::ClientContext context;
  set_deadline(context);
  const auto stub = v1::Palpation::NewStub(channel);
  FingerReader finger(*stub, context, "watched");
  v1::TouchRequest pose;
  for (const double v : {0.0512, -0.004}) pose.mutable_pose()->add_position_m(v);
  for (const double v : {0.12, 0.0}) pose.mutable_pose()->add_velocity_m_s(v);
  ASSERT_TRUE(toucher.send(pose));
  v1::FingerState state;
  do ASSERT_TRUE(finger.read(&state));
  while (state.position_m_size() == 0);
  EXPECT_TRUE(state.present());
  EXPECT_EQ(state.position_m(0), 0.0512);
  EXPECT_EQ(state.velocity_m_s(0), 0.12);
  EXPECT_GT(state.stamp().monotonic_ns(), 0);
  // A finger at rest is told of all the same.
  const auto rests = std::chrono::steady_clock::now();
  for (int beat = 0; beat < 2; ++beat) {
    ASSERT_TRUE(finger.read(&state));
    EXPECT_EQ(state.position_m(0), 0.0512);
  }
  EXPECT_LT(std::chrono::steady_clock::now() - rests, std::chrono::seconds(2));
  EXPECT_TRUE(toucher.finish().ok());
  do ASSERT_TRUE(finger.read(&state));
  while (state.present());
  context.TryCancel();
}

TEST_F(Palpation, ManyStreamsEndWhenTheirClientsDie) {
  Limits limits;
  limits.max_touch_streams = 64;  // fewer than calls of one connection
  RunningServer few("", "", limits);
  few->make_ready();
  ASSERT_TRUE(few.create(uniform_scene("s")).ok());
  const auto channel = few.channel();
  for (int round = 0; round < 3; ++round) {
    std::vector<std::unique_ptr<Toucher>> touchers;
    for (std::size_t k = 0; k < limits.max_touch_streams; ++k) {
      touchers.push_back(
          std::make_unique<Toucher>(channel, Toucher::open_on("s"), "client-" + std::to_string(k)));
      ASSERT_TRUE(touchers.back()->opened()) << k;
    }
    Toucher one_too_many(channel, "s");
    const grpc::Status refused = one_too_many.finish();
    const std::string load =
        "all " + std::to_string(limits.max_touch_streams) + " places for touch streams are taken; ";
    expect_refused(refused, grpc::StatusCode::RESOURCE_EXHAUSTED, load.c_str());
    expect_refused(refused, grpc::StatusCode::RESOURCE_EXHAUSTED,
                   round == 0 ? "try again in " : " as of late: try again in ");
    touchers.clear();
    few.expect_all_calls_end();
  }
}

}  // namespace
}  // namespace teletact::service
