// A model in three dimensions through the whole service: what a client sends and gets has all components.
#include <cmath>

#include "service/base/choices.h"
#include "tests/rpc/estimate_client.h"
#include "tests/scene/half_space.h"

namespace teletact::service {
namespace {

class ServedHalfSpace : public OnOneServer {
 protected:
  static void SetUpTestSuite() { serve({}, std::make_shared<const HalfSpaces>()); }
};

TEST_F(ServedHalfSpace, AnswersInThreeComponents) {
  Toucher toucher(channel, "s");
  v1::TouchOpened opened;
  ASSERT_TRUE(toucher.opened(&opened));
  EXPECT_EQ(opened.layer().depth_m(), 0);
  constexpr double kIndentationM = 0.002;
  const Vector3 at = on_tilted_surface(0.05, 0.015, kIndentationM), n = tilted_surface().normal;
  ASSERT_EQ(opened.layer().normal_size(), 3);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(opened.layer().normal(i), n[std::size_t(i)]);
  v1::TouchRequest request;
  for (const double x_m : at) request.mutable_pose()->add_position_m(x_m);
  ASSERT_TRUE(toucher.send(request));
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.read(&answer));
  ASSERT_EQ(answer.status(), v1::TOUCH_STATUS_OK) << answer.warning();
  EXPECT_EQ(answer.path(), v1::SOLVE_PATH_UNSPECIFIED) << "a way of its own";
  EXPECT_EQ(answer.solve().reason(), "closed form");
  EXPECT_GT(answer.solve().relative_force_error(), 0);
  ASSERT_EQ(answer.force_n_size(), 3);
  ASSERT_EQ(answer.tangent_n_m_size(), 9);
  const double force_n = std::hypot(answer.force_n(0), answer.force_n(1), answer.force_n(2));
  EXPECT_GT(force_n, 0.01);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(answer.force_n(i), -force_n * n[std::size_t(i)], 1e-12);
    for (int j = 0; j < 3; ++j)  // Hertz: dF/dd = 3/2 F / d
      EXPECT_NEAR(answer.tangent_n_m(3 * i + j),
                  -1.5 * force_n / kIndentationM * n[std::size_t(i)] * n[std::size_t(j)],
                  1e-9 * force_n / kIndentationM);
  }
}

TEST_F(ServedHalfSpace, TellsTheLightTouchBelowWithAllItsComponents) {
  Toucher toucher(channel, "s");
  ASSERT_TRUE(toucher.opened());
  const Vector3 above = on_tilted_surface(0.05, 0.015, -0.001), n = tilted_surface().normal;
  v1::TouchRequest request;
  for (const double x_m : above) request.mutable_pose()->add_position_m(x_m);
  ASSERT_TRUE(toucher.send(request));
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.read(&answer));
  ASSERT_TRUE(answer.has_foreseen());
  ASSERT_EQ(answer.foreseen().position_m_size(), 3);
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(answer.foreseen().position_m(i),
                above[std::size_t(i)] + (0.001 + choices::kLightTouch) * n[std::size_t(i)], 1e-12);
  EXPECT_LT(answer.foreseen().force_n(2), 0);
}

TEST_F(ServedHalfSpace, RefusesWhatItDoesNotDoWhenTheStreamOpens) {
  const auto refused = [](auto change, const char* field) {
    v1::TouchOpen open = Toucher::open_on("s");
    change(open);
    Toucher toucher(server->channel(), open);
    EXPECT_FALSE(toucher.opened());
    expect_refused(toucher.finish(), grpc::StatusCode::INVALID_ARGUMENT, field);
  };
  refused([](auto& o) { o.mutable_layer()->set_depth_m(0.01); }, "open.layer.depth_m");
  refused([](auto& o) { o.set_path(v1::SOLVE_PATH_GRADIENTS); }, "open.path");
  refused([](auto& o) { o.mutable_fingertip()->set_stuck(true); }, "open.fingertip.shape");
}

}  // namespace
}  // namespace teletact::service
