// Tactile images as they travel: what a display at the other end reads.
#include <cmath>
#include <cstring>
#include <vector>

#include "tests/rpc/running_server.h"

namespace teletact::service {
namespace {

constexpr double kBallX = 0.02;

// A ball of 5 mm and contrast 5 in the middle, 8 mm deep.
v1::CreateSceneRequest with_a_ball(const std::string& id) {
  return solid_scene(id, 10, 20, [](double x_m, double y_m, double z_m) {
    return std::hypot(x_m - kBallX, y_m - 0.008, z_m) < 0.005 ? 5e4F : 1e4F;
  });
}

std::vector<float> taxels(const v1::Array& array) {
  EXPECT_EQ(array.dtype(), v1::DATA_TYPE_FLOAT32);
  std::vector<float> out(array.data().size() / sizeof(float));
  std::memcpy(out.data(), array.data().data(), array.data().size());
  return out;
}

class TactileCalls : public OnOneServer {
 protected:
  // The first image of a pose at this depth; the answers before it are read.
  static v1::TactileImage image_at(Toucher& toucher, double y_m, v1::TouchAnswer& answer) {
    const std::uint64_t before = toucher.sequence();
    for (int k = 0; k < 100'000; ++k) {
      v1::TouchRequest pose;
      for (const double at_m : {kBallX, y_m, 0.0}) pose.mutable_pose()->add_position_m(at_m);
      if (!toucher.send(pose) || !toucher.read(&answer)) break;
      if (answer.has_tactile() && answer.tactile().sequence() > before) return answer.tactile();
    }
    ADD_FAILURE() << "no image came: " << answer.warning();
    return {};
  }
};

TEST_F(TactileCalls, ImageHasTheForceAndShowsTheLump) {
  ASSERT_TRUE(server->create(with_a_ball("solid")).ok());
  for (const bool pad : {false, true}) {
    v1::TouchOpen open = Toucher::open_on("solid");
    open.mutable_tactile()->set_taxels_x(10);
    open.mutable_tactile()->set_taxels_z(12);
    if (pad) open.mutable_fingertip()->set_shape(v1::FINGERTIP_SHAPE_PAD);
    Toucher toucher(channel, open);
    ASSERT_TRUE(toucher.opened());
    v1::TouchAnswer answer;
    const v1::TactileImage image = image_at(toucher, 0.0015, answer);
    EXPECT_LE(image.sequence(), answer.sequence());
    ASSERT_EQ(image.centre_m_size(), 3);
    EXPECT_EQ(image.centre_m(0), kBallX);
    EXPECT_EQ(image.centre_m(1), 0);
    EXPECT_EQ(image.pitch_m(), 0.002);
    ASSERT_EQ(image.pressure_pa().shape_size(), 2);
    EXPECT_EQ(image.pressure_pa().shape(0), 12U);
    EXPECT_EQ(image.pressure_pa().shape(1), 10U);
    const std::vector<float> pressure = taxels(image.pressure_pa()),
                             beyond = taxels(image.beyond_homogeneous_pa());
    ASSERT_EQ(pressure.size(), 120u);
    ASSERT_EQ(beyond.size(), 120u);
    double force = 0, more = 0, largest = 0;
    for (std::size_t t = 0; t < pressure.size(); ++t) {
      force += 4e-6 * pressure[t];
      more += 4e-6 * beyond[t];
      largest = std::max(largest, 4e-6 * beyond[t]);
    }
    EXPECT_NEAR(force + image.outside_n(), image.force_n(), 1e-6 * image.force_n());
    EXPECT_NEAR(force, -answer.force_n(1), 0.03 * force) << "but for the skin's part";
    EXPECT_NEAR(more, 0, 0.01 * force) << "at equal force";
    EXPECT_GT(largest, 0.002 * force);
    EXPECT_GT(beyond[5 * 10 + 4], 0) << "over the lump there is more";
    ASSERT_EQ(image.outside_moment_n_m_size(), 2);
    const v1::TactileImage above = image_at(toucher, -0.002, answer);
    EXPECT_EQ(above.force_n(), 0);
    for (const v1::Array* array : {&above.pressure_pa(), &above.beyond_homogeneous_pa()})
      EXPECT_EQ(taxels(*array), std::vector<float>(120, 0));
    toucher.finish();
  }
}

TEST_F(TactileCalls, ComesOnRequestAloneAndWhatCannotBeIsRefused) {
  Toucher plain(channel, "s");
  ASSERT_TRUE(plain.opened());
  v1::TouchAnswer answer;
  for (int k = 0; k < 5; ++k) {
    ASSERT_TRUE(plain.touch(0.05, 0.003, &answer));
    EXPECT_FALSE(answer.has_tactile());
  }
  const auto refused = [&](const auto& change, const char* words) {
    v1::TouchOpen open = Toucher::open_on("s");
    change(open);
    Toucher toucher(channel, open);
    EXPECT_FALSE(toucher.opened());
    expect_refused(toucher.finish(), grpc::StatusCode::INVALID_ARGUMENT, words);
  };
  refused([](auto& open) { open.mutable_tactile()->set_taxels_x(33); }, "open.tactile.taxels_x: 33");
  refused([](auto& open) { open.mutable_tactile()->set_taxels_z(4'000'000'000U); }, "open.tactile.taxels_z");
  refused([](auto& open) { open.mutable_tactile()->set_pitch_m(-1); }, "open.tactile.pitch_m: -1");
  refused([](auto& open) { open.mutable_tactile()->set_pitch_m(NAN); }, "open.tactile.pitch_m");
  refused([](auto& open) { open.mutable_fingertip()->set_shape(v1::FINGERTIP_SHAPE_PAD); },
          "open.fingertip.shape: a pad");
  refused([](auto& open) { open.mutable_fingertip()->set_shape(v1::FINGERTIP_SHAPE_SPHERE); },
          "open.fingertip.shape: a sphere");
  const auto pad = [](auto& open) { open.mutable_fingertip()->set_shape(v1::FINGERTIP_SHAPE_PAD); };
  refused([&](auto& open) { pad(open), open.mutable_fingertip()->set_pad_thickness_m(1); },
          "open.fingertip.pad_thickness_m: 1");
  refused([&](auto& open) { pad(open), open.mutable_fingertip()->set_pad_youngs_modulus_pa(NAN); },
          "open.fingertip.pad_youngs_modulus_pa");
}

}  // namespace
}  // namespace teletact::service
