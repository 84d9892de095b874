// Scenes as a client makes, reads and deletes them.
#include <cstring>
#include <vector>

#include "tests/rpc/estimate_client.h"
#include "tests/support/finger_reader.h"

namespace teletact::service {
namespace {

class SceneCalls : public OnOneServer {
 protected:
  const std::unique_ptr<v1::Palpation::Stub> stub = v1::Palpation::NewStub(channel);
};

TEST_F(SceneCalls, SceneThatIsNotCoveredHasNoForce) {
  v1::CreateSceneRequest request = uniform_scene("empty");
  request.clear_modulus();
  v1::Scene scene;
  ASSERT_TRUE(server->create(request, "", &scene).ok());
  EXPECT_EQ(scene.version(), 0U);
  Toucher toucher(channel, "empty");
  ASSERT_TRUE(toucher.opened());
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.touch(0.05, 0.003, &answer));
  EXPECT_EQ(answer.status(), v1::TOUCH_STATUS_NOT_COVERED);
  EXPECT_EQ(answer.force_n(1), 0);
}

TEST_F(SceneCalls, DeletingASceneEndsItsStreams) {
  ASSERT_TRUE(server->create(uniform_scene("doomed")).ok());
  Toucher toucher(channel, "doomed");
  ASSERT_TRUE(toucher.opened());
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.touch(0.05, 0.003, &answer));
  grpc::ClientContext watching;
  set_deadline(watching);
  FingerReader finger(*stub, watching, "doomed");
  v1::FingerState state;
  ASSERT_TRUE(finger.read(&state));
  ASSERT_TRUE(server->remove("doomed").ok());
  expect_refused(toucher.finish(), grpc::StatusCode::ABORTED, "doomed");
  expect_refused(finger.finish(), grpc::StatusCode::ABORTED, "doomed");
}

TEST_F(SceneCalls, ScenesThatMakeNoSenseAreNamed) {
  Bystander bystander(server->channel(), "s");
  using enum grpc::StatusCode;
  const auto refused = [](const v1::CreateSceneRequest& request, grpc::StatusCode code, const char* field) {
    expect_refused(server->create(request), code, field);
  };
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
    refused(with_modulus(modulus_pa), INVALID_ARGUMENT, "modulus.youngs_modulus_pa[10]");
  refused(changed([](auto& r) { r.mutable_geometry()->set_poisson_ratio(0.5); }), INVALID_ARGUMENT,
          "geometry.poisson_ratio");
  refused(changed([](auto& r) { r.mutable_geometry()->clear_size_m(); }), INVALID_ARGUMENT,
          "geometry.size_m");
  refused(changed([](auto& r) { r.mutable_geometry()->set_size_m(0, kNan); }), INVALID_ARGUMENT,
          "geometry.size_m[0]");
  refused(changed([](auto& r) { r.mutable_geometry()->set_size_m(1, 1e6); }), INVALID_ARGUMENT,
          "geometry.size_m[1]");
  refused(changed([](auto& r) { r.mutable_geometry()->mutable_supports(); }), INVALID_ARGUMENT,
          "geometry.supports: no face is held");
  // solids
  refused(changed([](auto& r) { r.mutable_geometry()->add_size_m(0.03); }), INVALID_ARGUMENT,
          "geometry.size_m[2]");
  refused(changed([](auto& r) { r.mutable_geometry()->mutable_supports()->set_z_min(true); }),
          INVALID_ARGUMENT, "geometry.supports.z_min");
  refused(changed([](auto& r) { r.mutable_geometry()->mutable_supports()->set_z_max(true); }),
          INVALID_ARGUMENT, "geometry.supports.z_max");
  refused(changed([](auto& r) { r.mutable_modulus()->add_z_m(0); }), INVALID_ARGUMENT, "modulus.z_m");
  refused(changed([](auto& r) { r.mutable_geometry()->set_thickness_m(-1); }), INVALID_ARGUMENT,
          "geometry.thickness_m");
  refused(
      changed([](auto& r) { r.mutable_modulus()->mutable_youngs_modulus_pa()->mutable_data()->pop_back(); }),
      INVALID_ARGUMENT, "modulus.youngs_modulus_pa.data");
  refused(
      changed([](auto& r) { r.mutable_modulus()->mutable_youngs_modulus_pa()->set_shape(0, 4000000000U); }),
      INVALID_ARGUMENT, "modulus.youngs_modulus_pa.shape");
  refused(changed([](auto& r) { r.mutable_modulus()->set_x_m(3, 0.001); }), INVALID_ARGUMENT, "modulus.x_m");
  // By the contract's name, and with the number that it is, however small.
  refused(changed([](auto& r) { r.mutable_modulus()->set_y_m(0, 5e-324); }), INVALID_ARGUMENT,
          "modulus.y_m[0]: 5e-324 m");
  refused(changed([](auto& r) { r.set_scene_id("../../etc"); }), INVALID_ARGUMENT, "scene_id");
  refused(uniform_scene("s"), ALREADY_EXISTS, "scene_id");
  grpc::ClientContext context;
  v1::GetSceneRequest request;
  request.set_scene_id("bad");
  v1::Scene scene;
  EXPECT_EQ(stub->GetScene(&context, request, &scene).error_code(), NOT_FOUND);
  bystander.stop();
  EXPECT_EQ(bystander.failures(), 0);
  EXPECT_GT(bystander.answers(), 0U);
}

// A modulus in three dimensions makes a solid, which is touched with all three components.
TEST_F(SceneCalls, SolidIsCreatedAndTouched) {
  const v1::CreateSceneRequest request =
      solid_scene("solid", 8, 10, [](double, double, double z_m) { return z_m < 0 ? 1e4F : 2e4F; });
  v1::CreateSceneRequest flat = request;
  flat.mutable_modulus()->mutable_youngs_modulus_pa()->mutable_shape()->RemoveLast();
  EXPECT_EQ(server->create(flat).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  v1::Scene scene;
  const grpc::Status created = server->create(request, "", &scene);
  ASSERT_TRUE(created.ok()) << created.error_message();
  ASSERT_EQ(scene.windows_size(), 1);
  EXPECT_DOUBLE_EQ(scene.windows(0).covers().begin_z_m(), -0.01);
  EXPECT_NEAR(scene.windows(0).covers().end_z_m(), 0.01, 1e-12);
  for (const double asked_m : {0.0, 0.0045}) {  // rows are 2.5 mm apart
    v1::TouchOpen open = Toucher::open_on("solid");
    open.mutable_layer()->set_depth_m(asked_m);
    open.set_path(v1::SOLVE_PATH_GRADIENTS);
    Toucher toucher(channel, open);
    v1::TouchOpened opened;
    ASSERT_TRUE(toucher.opened(&opened));
    const double depth_m = opened.layer().depth_m();
    EXPECT_DOUBLE_EQ(depth_m, asked_m > 0 ? 0.005 : 0);
    v1::TouchAnswer answer;
    const auto late = [&answer] {  // a busy machine's correction takes longer than an answer waits
      return answer.status() == v1::TOUCH_STATUS_FAILED &&
             answer.warning().find("still being solved") != std::string::npos;
    };
    int asked = 0;
    do {  // it is made ready
      v1::TouchRequest pose;
      for (const double x_m : {0.02, depth_m + 0.0015, 0.0}) pose.mutable_pose()->add_position_m(x_m);
      ASSERT_TRUE(toucher.send(pose));
      ASSERT_TRUE(toucher.read(&answer));
    } while (answer.status() == v1::TOUCH_STATUS_PREPARING || (late() && ++asked < 50));
    ASSERT_EQ(answer.status(), v1::TOUCH_STATUS_OK) << answer.warning();
    EXPECT_LT(answer.force_n(1), -0.05);
    EXPECT_LT(answer.force_n(2), -0.001) << "from the harder half";
    EXPECT_NEAR(answer.force_n(0), 0, 0.003 * -answer.force_n(1));
    EXPECT_NE(answer.tangent_n_m(8), 0);
    ASSERT_EQ(answer.budget().terms_size(), 4);
    EXPECT_EQ(answer.budget().terms(0).term(), v1::ForceError::TERM_SOLVER);
    EXPECT_EQ(answer.budget().terms(0).kind(), v1::ForceError::KIND_BOUND);
    EXPECT_EQ(answer.budget().terms(0).relative(), answer.solve().relative_force_error());
    EXPECT_EQ(answer.budget().terms(1).term(), v1::ForceError::TERM_MESH);
    EXPECT_EQ(answer.budget().terms(2).kind(), v1::ForceError::KIND_ESTIMATE);
    EXPECT_EQ(answer.budget().terms(3).term(), v1::ForceError::TERM_CONTEXT);
    EXPECT_GT(answer.budget().above(), 0);
    EXPECT_GT(answer.budget().half_width(), answer.budget().terms(0).relative());
  }
  for (const double wrong : {-0.1, 1.1, double(NAN)}) {
    v1::TouchOpen open = Toucher::open_on("solid");
    open.mutable_tolerance()->set_relative(wrong);
    Toucher refused(channel, open);
    EXPECT_FALSE(refused.opened());
    EXPECT_NE(refused.finish().error_message().find("open.tolerance.relative"), std::string::npos);
  }
  v1::TouchOpen below = Toucher::open_on("solid");
  below.mutable_layer()->set_depth_m(0.021);
  Toucher refused(channel, below);
  EXPECT_FALSE(refused.opened());
  const grpc::Status why = refused.finish();
  EXPECT_EQ(why.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_NE(why.error_message().find("open.layer.depth_m: 0.021"), std::string::npos) << why.error_message();
}

// By name, or where they are good enough; the scene says whether they are for a usual touch, and why.
TEST_F(SceneCalls, SharesAnswerASolidWhereTheyAreGoodEnough) {
  ASSERT_TRUE(server->create(solid_scene("even", 8, 10, [](double, double, double) { return 1e4F; })).ok());
  const auto plan = [this] {
    grpc::ClientContext context;
    v1::GetSceneRequest request;
    request.set_scene_id("even");
    v1::Scene scene;
    EXPECT_TRUE(stub->GetScene(&context, request, &scene).ok());
    return scene.windows(0).plan();
  };
  EXPECT_NE(plan().find("at the first touch"), std::string::npos) << plan();
  v1::TouchAnswer answer;
  const auto touch = [&](v1::SolvePath path, v1::SolvePath until) {
    v1::TouchOpen open = Toucher::open_on("even");
    open.set_path(path);
    Toucher toucher(channel, open);
    ASSERT_TRUE(toucher.opened());
    for (int asked = 0; asked < 2000; ++asked) {  // it is made ready, and learns
      v1::TouchRequest pose;
      for (const double at_m : {0.02, 0.0015, 0.0}) pose.mutable_pose()->add_position_m(at_m);
      ASSERT_TRUE(toucher.send(pose));
      ASSERT_TRUE(toucher.read(&answer));
      if (answer.status() == v1::TOUCH_STATUS_OK && answer.path() == until) break;
    }
  };
  touch(v1::SOLVE_PATH_UNSPECIFIED, v1::SOLVE_PATH_SHARES);
  ASSERT_EQ(answer.path(), v1::SOLVE_PATH_SHARES) << answer.warning();
  EXPECT_TRUE(answer.solve().converged());
  EXPECT_EQ(answer.budget().terms(0).term(), v1::ForceError::TERM_MODEL);
  EXPECT_NE(plan().find("answered by log-weighted shares: at 2 mm"), std::string::npos) << plan();
  const double planned_n = answer.force_n(1);
  touch(v1::SOLVE_PATH_SHARES, v1::SOLVE_PATH_SHARES);
  EXPECT_EQ(answer.path(), v1::SOLVE_PATH_SHARES);
  EXPECT_EQ(answer.force_n(1), planned_n);
  for (const char* scene : {"even", "s"}) {
    v1::TouchOpen open = Toucher::open_on(scene);
    open.set_path(v1::SOLVE_PATH_SHARES);
    open.set_pressure(true);
    Toucher refused(channel, open);
    EXPECT_FALSE(refused.opened());
    EXPECT_NE(refused.finish().error_message().find("open.path: SHARES"), std::string::npos);
  }
}

// GIVEN the number of a model that is there no more, WHEN a touch asks for it, THEN it is told which ones
// are.
TEST_F(SceneCalls, APathThatIsGoneIsRefusedWithThoseThatAreThere) {
  for (const int gone : {3, 4}) {
    v1::TouchOpen open = Toucher::open_on("s");
    open.set_path(static_cast<v1::SolvePath>(gone));
    Toucher refused(channel, open);
    EXPECT_FALSE(refused.opened());
    const grpc::Status status = refused.finish();
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    EXPECT_NE(status.error_message().find("use COMPLIANCE, GRADIENTS or SHARES"), std::string::npos)
        << status.error_message();
  }
}

TEST_F(SceneCalls, SceneIsHeldWhereItsSupportsSay) {
  v1::CreateSceneRequest request = uniform_scene("held");
  request.mutable_geometry()->mutable_supports()->set_x_min(true);
  v1::Scene scene;
  ASSERT_TRUE(server->create(request, "", &scene).ok());
  v1::Supports expected;
  expected.set_x_min(true);
  EXPECT_EQ(scene.geometry().supports().SerializeAsString(), expected.SerializeAsString());
  // none said: the bottom alone
  request = uniform_scene("lies");
  ASSERT_TRUE(server->create(request, "", &scene).ok());
  expected.Clear();
  expected.set_bottom(true);
  EXPECT_EQ(scene.geometry().supports().SerializeAsString(), expected.SerializeAsString());
}

TEST_F(SceneCalls, SceneIsReadBack) {
  grpc::ClientContext context;
  v1::GetSceneRequest request;
  request.set_scene_id("s");
  request.set_view(v1::SCENE_VIEW_FULL);
  v1::Scene scene;
  ASSERT_TRUE(stub->GetScene(&context, request, &scene).ok());
  ASSERT_EQ(scene.windows_size(), 1);
  EXPECT_EQ(scene.windows(0).covers().begin_x_m(), 0);
  EXPECT_NEAR(scene.windows(0).covers().end_x_m(), 0.1, 1e-12);
  EXPECT_FALSE(scene.windows(0).covers().has_begin_z_m());
  EXPECT_EQ(scene.geometry().size_m_size(), 2);
  EXPECT_EQ(scene.geometry().poisson_ratio(), 0.49);
  ASSERT_EQ(scene.youngs_modulus().grid().size_size(), 2);
  const auto& values = scene.youngs_modulus().values();
  EXPECT_EQ(values.data().size(), std::size_t{4} * values.shape(0) * values.shape(1));
  float modulus_pa = 0;
  std::memcpy(&modulus_pa, values.data().data() + 400, 4);
  EXPECT_NEAR(modulus_pa, 10e3, 1);
  EXPECT_EQ(scene.valid().values().data()[7], 1);
}

}  // namespace
}  // namespace teletact::service
