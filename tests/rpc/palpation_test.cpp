#include <cstring>
#include <limits>
#include <vector>

#include "tests/rpc/estimate_client.h"
#include "tests/rpc/running_server.h"
#include "tests/support/finger_reader.h"

namespace teletact::service {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

class Palpation : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    server = std::make_unique<RunningServer>();
    (*server)->make_ready();
  }
  static void TearDownTestSuite() { server.reset(); }

  Palpation() : channel(server->channel()), stub(v1::Palpation::NewStub(channel)) {
    EXPECT_TRUE(create(uniform_scene("uniform")).ok());
  }
  ~Palpation() override {
    grpc::ClientContext context;
    v1::ListScenesResponse scenes;
    stub->ListScenes(&context, {}, &scenes);
    for (const v1::Scene& scene : scenes.scenes()) {
      grpc::ClientContext one;
      v1::DeleteSceneRequest request;
      v1::DeleteSceneResponse response;
      request.set_scene_id(scene.scene_id());
      stub->DeleteScene(&one, request, &response);
    }
  }
  grpc::Status create(const v1::CreateSceneRequest& request, v1::Scene* scene = nullptr) {
    grpc::ClientContext context;
    set_deadline(context);
    v1::Scene made;
    const grpc::Status status = stub->CreateScene(&context, request, &made);
    if (scene) *scene = made;
    return status;
  }
  void expect_refused(const v1::CreateSceneRequest& request, grpc::StatusCode code, const char* field) {
    const grpc::Status status = create(request);
    EXPECT_EQ(status.error_code(), code) << status.error_message();
    EXPECT_NE(status.error_message().find(field), std::string::npos) << status.error_message();
  }
  // The stream ends with this code, and names the field.
  static void expect_end(Toucher& toucher, grpc::StatusCode code, const char* field) {
    const grpc::Status status = toucher.finish();
    EXPECT_EQ(status.error_code(), code) << status.error_message();
    EXPECT_NE(status.error_message().find(field), std::string::npos) << status.error_message();
  }

  static inline std::unique_ptr<RunningServer> server;
  std::shared_ptr<grpc::Channel> channel;
  std::unique_ptr<v1::Palpation::Stub> stub;
};

TEST_F(Palpation, AnswerCarriesThePoseItBelongsTo) {
  Toucher toucher(channel, "uniform");
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
  EXPECT_GT(answer.compute_ns(), 0);
  EXPECT_GE(answer.queued_ns(), 0);
  EXPECT_GT(answer.model_version(), 0U);
  EXPECT_EQ(answer.answer_stamp().instance(), opened.instance());
  EXPECT_EQ(answer.model_stamp().instance(), opened.instance());
  EXPECT_GT(answer.model_stamp().monotonic_ns(), 0);
  EXPECT_LT(answer.model_stamp().monotonic_ns(), answer.answer_stamp().monotonic_ns());
  EXPECT_TRUE(toucher.finish().ok());
}

TEST_F(Palpation, ForceIsTheWorkThatThePoseDoes) {
  Toucher toucher(channel, "uniform");
  ASSERT_TRUE(toucher.opened());
  v1::TouchAnswer before, after, middle;
  const double step_m = 1e-5;
  ASSERT_TRUE(toucher.touch(0.0503, 0.003 - step_m, &before));
  ASSERT_TRUE(toucher.touch(0.0503, 0.003 + step_m, &after));
  ASSERT_TRUE(toucher.touch(0.0503, 0.003, &middle));
  const double slope = (after.energy_j() - before.energy_j()) / (2 * step_m);
  EXPECT_NEAR(middle.force_n(1), -slope, 1e-3 * std::abs(slope));
}

TEST_F(Palpation, PcgGivesTheSameForceByRequest) {
  v1::TouchOpen open = Toucher::open_on("uniform");
  open.set_path(v1::SOLVE_PATH_PCG);
  Toucher by_pcg(server->channel(), open), by_compliance(channel, "uniform");
  ASSERT_TRUE(by_pcg.opened() && by_compliance.opened());
  v1::TouchAnswer pcg, compliance;
  do {  // a busy machine solves the columns of the contact in several goes, and says so
    ASSERT_TRUE(by_pcg.touch(0.0503, 0.002, &pcg));
  } while (pcg.warning().find("being solved") != std::string::npos);
  ASSERT_TRUE(by_compliance.touch(0.0503, 0.002, &compliance));
  EXPECT_EQ(pcg.path(), v1::SOLVE_PATH_PCG) << pcg.warning();
  EXPECT_GT(pcg.solve().iterations(), 0U);
  EXPECT_NEAR(pcg.force_n(1), compliance.force_n(1), 2e-3 * std::abs(compliance.force_n(1)));
}

// Its first answers come while it is made elsewhere, and say so.
TEST_F(Palpation, InteriorLineIsPreparedBeforeItHasAForce) {
  v1::TouchOpen open = Toucher::open_on("uniform");
  open.set_line_y_m(0.02);
  Toucher toucher(channel, open);
  v1::TouchOpened opened;
  ASSERT_TRUE(toucher.opened(&opened));
  v1::TouchAnswer first, ready;
  ASSERT_TRUE(toucher.send(0.05, opened.line_y_m() + 0.002) && toucher.read(&first));
  EXPECT_EQ(first.status(), v1::TOUCH_STATUS_PREPARING);
  EXPECT_EQ(first.force_n(1), 0);
  EXPECT_NE(first.warning(), "");
  ASSERT_TRUE(toucher.touch(0.05, opened.line_y_m() + 0.002, &ready));
  EXPECT_EQ(ready.status(), v1::TOUCH_STATUS_OK) << ready.warning();
  EXPECT_LT(ready.force_n(1), 0);
}

TEST_F(Palpation, SilentReaderGetsNoMoreThanItsCredit) {
  v1::TouchOpen open = Toucher::open_on("uniform");
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
  Toucher toucher(channel, "uniform");
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

TEST_F(Palpation, PosesThatMakeNoSenseEndTheirStreamAloneAndNameTheField) {
  Toucher bystander(server->channel(), "uniform");
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
    Toucher toucher(channel, "uniform");
    ASSERT_TRUE(toucher.opened());
    v1::TouchRequest request;
    v1::ContactPose* pose = request.mutable_pose();
    pose->mutable_position_m()->Add(bad.position_m.begin(), bad.position_m.end());
    pose->mutable_velocity_m_s()->Add(bad.velocity_m_s.begin(), bad.velocity_m_s.end());
    pose->set_sequence(bad.sequence);
    pose->set_acknowledged(bad.acknowledged);
    toucher.send_as_is(request);
    expect_end(toucher, grpc::StatusCode::INVALID_ARGUMENT, bad.field);
    v1::TouchAnswer answer;
    ASSERT_TRUE(bystander.touch(0.05, 0.002, &answer));
    EXPECT_EQ(answer.status(), v1::TOUCH_STATUS_OK);
  }
}

TEST_F(Palpation, FingerThatLeavesTheTissueIsAnsweredAndComesBack) {
  // GIVEN a finger that is felt
  Toucher toucher(channel, "uniform");
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
  Bystander bystander(server->channel(), "uniform");
  const auto refused = [&](grpc::StatusCode code, const char* field, auto change) {
    v1::TouchOpen open = Toucher::open_on("uniform");
    change(open);
    Toucher toucher(channel, open);
    expect_end(toucher, code, field);
  };
  using enum grpc::StatusCode;
  refused(NOT_FOUND, "scene_id", [](auto& o) { o.set_scene_id("nowhere"); });
  // Longer than a status may be: what is shown of it is cut, so that the message arrives.
  refused(NOT_FOUND, "scene_id", [](auto& o) { o.set_scene_id(std::string(1 << 20, '\n')); });
  refused(INVALID_ARGUMENT, "open.credit", [](auto& o) { o.set_credit(9); });
  refused(INVALID_ARGUMENT, "open.credit", [](auto& o) { o.set_credit(1'000'000'000); });
  refused(INVALID_ARGUMENT, "open.period_s", [](auto& o) { o.set_period_s(-1); });
  refused(INVALID_ARGUMENT, "open.period_s", [](auto& o) { o.set_period_s(kNan); });
  refused(INVALID_ARGUMENT, "open.line_y_m", [](auto& o) { o.set_line_y_m(0.04); });
  refused(INVALID_ARGUMENT, "open.line_y_m", [](auto& o) { o.set_line_y_m(kNan); });
  refused(INVALID_ARGUMENT, "open.fingertip.radius_m",
          [](auto& o) { o.mutable_fingertip()->set_radius_m(0.5); });
  refused(INVALID_ARGUMENT, "open.fingertip.shape",
          [](auto& o) { o.mutable_fingertip()->set_shape(static_cast<v1::FingertipShape>(77)); });
  v1::TouchOpen open = Toucher::open_on("uniform");
  Toucher twice(channel, open);
  v1::TouchRequest again;
  *again.mutable_open() = open;
  twice.send_as_is(again);
  expect_end(twice, INVALID_ARGUMENT, "open");
  bystander.stop();
  EXPECT_EQ(bystander.failures(), 0);
  EXPECT_GT(bystander.answers(), 0U);
}

TEST_F(Palpation, PoseBeforeOpenIsRefused) {
  grpc::ClientContext context;
  set_deadline(context);
  const auto stream = stub->Touch(&context);
  v1::TouchRequest request;
  request.mutable_pose()->set_sequence(1);
  stream->Write(request);
  v1::TouchResponse response;
  EXPECT_FALSE(stream->Read(&response));
  EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(Palpation, SceneThatIsNotCoveredHasNoForce) {
  v1::CreateSceneRequest request = uniform_scene("empty");
  request.clear_modulus();
  v1::Scene scene;
  ASSERT_TRUE(create(request, &scene).ok());
  EXPECT_EQ(scene.version(), 0U);
  Toucher toucher(channel, "empty");
  ASSERT_TRUE(toucher.opened());
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.touch(0.05, 0.003, &answer));
  EXPECT_EQ(answer.status(), v1::TOUCH_STATUS_NOT_COVERED);
  EXPECT_EQ(answer.force_n(1), 0);
}

TEST_F(Palpation, DeletingASceneEndsItsStreams) {
  Toucher toucher(channel, "uniform");
  ASSERT_TRUE(toucher.opened());
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.touch(0.05, 0.003, &answer));
  grpc::ClientContext watching, deleting;
  set_deadline(watching);
  FingerReader finger(*stub, watching, "uniform");
  v1::FingerState state;
  ASSERT_TRUE(finger.read(&state));
  v1::DeleteSceneRequest request;
  v1::DeleteSceneResponse response;
  request.set_scene_id("uniform");
  ASSERT_TRUE(stub->DeleteScene(&deleting, request, &response).ok());
  expect_end(toucher, grpc::StatusCode::ABORTED, "uniform");
  EXPECT_EQ(finger.finish().error_code(), grpc::StatusCode::ABORTED);
}

TEST_F(Palpation, FingerIsWatched) {
  Toucher toucher(channel, "uniform");
  ASSERT_TRUE(toucher.opened());
  grpc::ClientContext context;
  set_deadline(context);
  FingerReader finger(*stub, context, "uniform");
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

TEST_F(Palpation, ScenesThatMakeNoSenseAreNamed) {
  Bystander bystander(server->channel(), "uniform");
  using enum grpc::StatusCode;
  const auto changed = [](auto change) {
    v1::CreateSceneRequest request = uniform_scene("bad");
    change(request);
    return request;
  };
  const auto with_modulus = [&](float modulus_pa) {
    return changed([&](auto& r) {
      std::string* data = r.mutable_modulus()->mutable_youngs_modulus_pa()->mutable_data();
      std::memcpy(data->data() + 40, &modulus_pa, sizeof(float));
    });
  };
  for (const float modulus_pa :
       {-10.0F, 0.0F, std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN()})
    expect_refused(with_modulus(modulus_pa), INVALID_ARGUMENT, "modulus.youngs_modulus_pa[10]");
  expect_refused(changed([](auto& r) { r.mutable_geometry()->set_poisson_ratio(0.5); }), INVALID_ARGUMENT,
                 "geometry.poisson_ratio");
  expect_refused(changed([](auto& r) { r.mutable_geometry()->clear_size_m(); }), INVALID_ARGUMENT,
                 "geometry.size_m");
  expect_refused(changed([](auto& r) { r.mutable_geometry()->set_size_m(0, kNan); }), INVALID_ARGUMENT,
                 "geometry.size_m[0]");
  expect_refused(changed([](auto& r) { r.mutable_geometry()->set_size_m(1, 1e6); }), INVALID_ARGUMENT,
                 "geometry.size_m[1]");
  expect_refused(changed([](auto& r) { r.mutable_geometry()->set_free_bottom(true); }), INVALID_ARGUMENT,
                 "geometry.free_bottom");
  expect_refused(changed([](auto& r) { r.mutable_geometry()->set_thickness_m(-1); }), INVALID_ARGUMENT,
                 "geometry.thickness_m");
  expect_refused(
      changed([](auto& r) { r.mutable_modulus()->mutable_youngs_modulus_pa()->mutable_data()->pop_back(); }),
      INVALID_ARGUMENT, "modulus.youngs_modulus_pa.data");
  expect_refused(
      changed([](auto& r) { r.mutable_modulus()->mutable_youngs_modulus_pa()->set_shape(0, 4000000000U); }),
      INVALID_ARGUMENT, "modulus.youngs_modulus_pa.shape");
  expect_refused(changed([](auto& r) { r.mutable_modulus()->set_x_m(3, 0.001); }), INVALID_ARGUMENT,
                 "modulus.x_m");
  expect_refused(changed([](auto& r) { r.set_scene_id("../../etc"); }), INVALID_ARGUMENT, "scene_id");
  expect_refused(uniform_scene("uniform"), ALREADY_EXISTS, "scene_id");
  grpc::ClientContext context;
  v1::GetSceneRequest request;
  request.set_scene_id("bad");
  v1::Scene scene;
  EXPECT_EQ(stub->GetScene(&context, request, &scene).error_code(), NOT_FOUND);
  bystander.stop();
  EXPECT_EQ(bystander.failures(), 0);
  EXPECT_GT(bystander.answers(), 0U);
}

TEST_F(Palpation, SceneIsReadBack) {
  grpc::ClientContext context;
  v1::GetSceneRequest request;
  request.set_scene_id("uniform");
  request.set_view(v1::SCENE_VIEW_FULL);
  v1::Scene scene;
  ASSERT_TRUE(stub->GetScene(&context, request, &scene).ok());
  EXPECT_EQ(scene.windows_size(), 1);
  EXPECT_EQ(scene.geometry().poisson_ratio(), 0.49);
  ASSERT_EQ(scene.youngs_modulus().grid().size_size(), 2);
  const auto& values = scene.youngs_modulus().values();
  EXPECT_EQ(values.data().size(), std::size_t{4} * values.shape(0) * values.shape(1));
  float modulus_pa = 0;
  std::memcpy(&modulus_pa, values.data().data() + 400, 4);
  EXPECT_NEAR(modulus_pa, 10e3, 1);
  EXPECT_EQ(scene.valid().values().data()[7], 1);
}

TEST_F(Palpation, ManyStreamsEndWhenTheirClientsDie) {
  for (int round = 0; round < 3; ++round) {
    std::vector<std::unique_ptr<Toucher>> touchers;
    for (std::size_t k = 0; k < Limits{}.most_touch_streams; ++k) {
      touchers.push_back(std::make_unique<Toucher>(channel, "uniform"));
      ASSERT_TRUE(touchers.back()->opened()) << k;
    }
    Toucher one_too_many(channel, "uniform");
    expect_end(one_too_many, grpc::StatusCode::RESOURCE_EXHAUSTED, "calls");
    touchers.clear();
    (*server)->core().calls.wait_until_none(Calls::Clock::now() + std::chrono::seconds(5));
    EXPECT_EQ((*server)->core().calls.count(), 0U);
  }
}

}  // namespace
}  // namespace teletact::service
