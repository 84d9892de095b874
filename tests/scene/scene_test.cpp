#include "service/scene/scene.h"

#include <gtest/gtest.h>

#include "service/device/cancellation.h"
#include "service/scene/errors.h"
#include "service/scene/tissue_models.h"
#include "service/touch_plane/touch_session.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

constexpr double kWidthM = 0.120, kDepthM = 0.030, kWindowM = 0.030;

class SceneWithWindows : public testing::Test {
 protected:
  Published publish(double x_m, double modulus_pa = 10e3) {
    return scene.publish(window_of(homogeneous(modulus_pa), x_m, kWindowM, kDepthM));
  }
  Scene scene{"s", tissue(kWidthM, kDepthM), versions()};
};

TEST_F(SceneWithWindows, EachPublicationIsTheNextVersion) {
  EXPECT_EQ(scene.snapshot()->version, 0U);
  const Published a = publish(0), b = publish(0.03), again = publish(0);
  EXPECT_GT(a.version, 0U);
  EXPECT_GT(b.version, a.version);
  EXPECT_GT(again.version, b.version);
  EXPECT_NE(a.window_id, b.window_id);
  EXPECT_EQ(again.window_id, a.window_id);
  EXPECT_EQ(scene.snapshot()->windows.size(), 2U);
}

TEST_F(SceneWithWindows, PublishedSnapshotNeverChanges) {
  publish(0);
  const auto before = scene.snapshot();
  const double modulus_pa = tissue_of(*before->windows[0]).problem().material.youngs_modulus_pa[0];
  publish(0, 40e3);
  EXPECT_EQ(before->windows.size(), 1U);
  EXPECT_EQ(tissue_of(*before->windows[0]).problem().material.youngs_modulus_pa[0], modulus_pa);
  EXPECT_NEAR(tissue_of(*scene.snapshot()->windows[0]).problem().material.youngs_modulus_pa[0], 40e3, 1);
}

TEST_F(SceneWithWindows, FingerKeepsItsWindowForTwoMillimetres) {
  const auto a = publish(0).window_id, b = publish(0.03).window_id;
  const auto at = [&](double x_m, std::uint64_t current) {
    return scene.snapshot()->window_at(x_m, current, 0.002)->id;
  };
  EXPECT_EQ(at(0.0299, 0), a);
  EXPECT_EQ(at(0.0301, 0), b);
  EXPECT_EQ(at(0.0319, a), a);
  EXPECT_EQ(at(0.0321, a), b);
  EXPECT_EQ(at(0.0281, b), b);
  EXPECT_EQ(at(0.0279, b), a);
}

TEST_F(SceneWithWindows, NothingIsCoveredBesideTheWindows) {
  EXPECT_EQ(scene.snapshot()->window_at(0.01, 0, 0.002), nullptr);
  const auto a = publish(0.03).window_id;
  EXPECT_EQ(scene.snapshot()->window_at(0.0299, a, 0.002), nullptr);  // no hysteresis into the unknown
  EXPECT_EQ(scene.snapshot()->window_at(0.0601, a, 0.002), nullptr);
  EXPECT_NE(scene.snapshot()->window_at(0.03, a, 0.002), nullptr);
}

TEST_F(SceneWithWindows, AdjoiningWindowsAreOneCoveredRange) {
  publish(0.03), publish(0), publish(0.09);
  const auto snapshot = scene.snapshot();
  EXPECT_NEAR(snapshot->covered_around(0.01).begin_x_m, 0, 1e-9);
  EXPECT_NEAR(snapshot->covered_around(0.01).end_x_m, 0.06, 1e-9);
  EXPECT_NEAR(snapshot->covered_around(0.1).begin_x_m, 0.09, 1e-9);
  EXPECT_EQ(snapshot->covered_around(0.07).begin_x_m, snapshot->covered_around(0.07).end_x_m);
  publish(0.06);
  EXPECT_NEAR(scene.snapshot()->covered_around(0.01).end_x_m, 0.12, 1e-9);
}

TEST_F(SceneWithWindows, AGapOfMillimetresIsNotCovered) {
  publish(0), publish(0.035);
  EXPECT_NEAR(scene.snapshot()->covered_around(0.01).end_x_m, 0.03, 1e-9);
  EXPECT_NEAR(scene.snapshot()->covered_around(0.04).begin_x_m, 0.035, 1e-9);
}

TEST_F(SceneWithWindows, NeighboursAreRebuiltWithTheNewContext) {
  const Published a = publish(0, 10e3);
  publish(0.03, 40e3);
  const auto stale = scene.snapshot();
  while (scene.refresh_stale_window()) {
  }
  const auto fresh = scene.snapshot();
  EXPECT_EQ(fresh->windows[0]->id, a.window_id);
  EXPECT_GT(fresh->windows[0]->version, stale->windows[0]->version);
  EXPECT_EQ(fresh->version, fresh->windows[0]->version);
  const auto modulus_at = [](const SceneSnapshot& s, double x_m) {
    const TissueModel& model = tissue_of(*s.windows[0]);
    std::size_t i = 0;
    while (model.problem().grid.x_m[i + 1] < x_m) ++i;
    return model.problem().material.youngs_modulus_pa[i];
  };
  EXPECT_NEAR(modulus_at(*stale, 0.0405), 10e3, 1);
  EXPECT_NEAR(modulus_at(*fresh, 0.0405), 40e3, 1);
  EXPECT_FALSE(scene.refresh_stale_window());
  EXPECT_EQ(scene.snapshot(), fresh);
}

// Parts of the models before are taken over: of the window itself when it is published again, of its
// neighbours when they get its context.
TEST_F(SceneWithWindows, ModelsThatFollowOthersAreThoseMadeAnew) {
  constexpr std::size_t kRow = 7;
  scene.use_layer(scene.layer_near(0.001 * kRow));
  for (const double begin_m : {0.0, 0.03, 0.06, 0.03, 0.015, 0.06, 0.06}) {
    scene.publish(
        window_of(inclusion(10e3, 3 + 100 * begin_m, begin_m + 0.012, 0.008, 0.006), begin_m, 0.03, kDepthM));
    while (scene.refresh_stale_window()) {
    }
    const auto snapshot = scene.snapshot();
    for (const auto& window : snapshot->windows) {
      const auto anew = build_window_tissue(scene.geometry(), *snapshot->map, window->region.begin_x_m,
                                            window->region.end_x_m);
      std::vector<std::size_t> nodes;
      for (std::size_t i = anew->problem().touchable.first; i <= anew->problem().touchable.last; ++i)
        nodes.push_back(i);
      for (const std::size_t row : {std::size_t{0}, kRow})
        EXPECT_EQ(tissue_of(*window).compliance(row)->among(nodes, nullptr),
                  anew->compliance(row)->among(nodes, nullptr))
            << "window at " << window->region.begin_x_m << " m, row " << row;
    }
  }
}

TEST_F(SceneWithWindows, WindowThatHidesOthersReplacesThem) {
  publish(0.03), publish(0.06);
  scene.publish(window_of(homogeneous(20e3), 0.02, 0.08, kDepthM));
  EXPECT_EQ(scene.snapshot()->windows.size(), 1U);
}

TEST_F(SceneWithWindows, PassesOfAProbeThatIsNotPreciseDoNotPileUp) {
  for (int pass = 0; pass < 12; ++pass)
    for (int k = 0; k < 3; ++k) publish(0.03 * k + 0.0017 * ((5 * pass + k) % 7));
  const auto snapshot = scene.snapshot();
  EXPECT_LE(snapshot->windows.size(), 8U);
  EXPECT_NEAR(snapshot->covered_around(0.05).begin_x_m, 0, 0.002);  // nothing that was covered is lost
  EXPECT_NEAR(snapshot->covered_around(0.05).end_x_m, 0.1, 0.002);
}

TEST_F(SceneWithWindows, CancelledPublicationChangesNothing) {
  publish(0);
  const auto before = scene.snapshot();
  {
    const CancellationCheck cancelled([] { throw Error(ErrorKind::kCancelled, "nobody waits for it"); });
    EXPECT_THROW(publish(0), Error);
  }
  scene.mark_deleted();
  EXPECT_THROW(publish(0.03), Error);
  EXPECT_EQ(scene.snapshot(), before);
}

TEST_F(SceneWithWindows, WindowOutsideTheTissueIsRefused) {
  for (const double x_m : {-0.01, 0.1, 5.0, -1e300, std::nan("")})
    EXPECT_THROW(publish(x_m), std::invalid_argument) << x_m;
}

TEST_F(SceneWithWindows, LayerThatIsHeldCannotBeTouched) {
  EXPECT_EQ(scene.layer_near(0.0004), Layer{});
  EXPECT_THROW(scene.layer_near(kDepthM), std::invalid_argument);
  EXPECT_THROW(scene.layer_near(-0.01), std::invalid_argument);
  EXPECT_THROW(scene.layer_near(std::nan("")), std::invalid_argument);
}

TEST(Layers, TheNearestIsTakenWithinHalfOfTheDistanceOfTwo) {
  class Two final : public TouchModels {
   public:
    std::vector<Layer> layers(const SceneGeometry&) const override { return {{0.004}, {0.006}}; }
    double context_m() const override { return 0; }
    std::shared_ptr<const TouchModel> of_window(const WantedModel&) const override { return nullptr; }
    std::shared_ptr<const TouchModel> of_modulus(const SceneGeometry&, const ExplicitModulus&,
                                                 const MemoryAccount&) const override {
      return nullptr;
    }
  };
  const Scene scene("s", tissue(kWidthM, kDepthM), versions(), {}, {}, std::make_shared<const Two>());
  for (const double depth_m : {0.003, 0.004, 0.0049}) EXPECT_EQ(scene.layer_near(depth_m), Layer{0.004});
  for (const double depth_m : {0.0051, 0.006, 0.007}) EXPECT_EQ(scene.layer_near(depth_m), Layer{0.006});
  for (const double depth_m : {0.0, 0.0029, 0.0071, 0.02})
    EXPECT_THROW(scene.layer_near(depth_m), std::invalid_argument) << depth_m;
}

}  // namespace
}  // namespace teletact::service
