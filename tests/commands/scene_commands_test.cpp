// What acquire, slices, touch and watch make of a scene and of its viewers.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "client/files/metaimage.h"
#include "client/watch/player.h"
#include "tests/commands/fake_service.h"

namespace teletact::client {
namespace {

v1::Scene scene_of(double width_m, double depth_m) {
  v1::Scene scene;
  for (const double size_m : {width_m, depth_m}) scene.mutable_geometry()->add_size_m(size_m);
  v1::Window& window = *scene.add_windows();
  window.mutable_covers()->set_end_x_m(width_m);
  window.set_touchable(true);
  return scene;
}

TEST(AcquireCommand, SceneOfAnotherDepthIsRefused) {
  test::CommandService service;
  const auto tissue = service.folder / "tissue.toml";
  put_content(tissue, "[tissue]\nwidth_m = 0.12\ndepth_m = 0.04\n");
  service.palpation.scene = scene_of(0.12, 0.06);
  const std::string failure = test::failure_of(
      {"acquire", "--service", service.address(), "--scene", "s", "--tissue", tissue.string()});
  EXPECT_NE(failure.find("another size"), std::string::npos) << failure;
}

TEST(SlicesCommand, ElementsBeginHalfAPitchBeforeTheFirstSlice) {
  test::CommandService service;
  const auto volume = service.folder / "volume.mha";
  const std::vector<float> pa(2 * 2 * 12, 1e4F);
  write_metaimage(volume, MetaImage::of<float>({2, 2, 12}, {0.01, 0.01, 0.002}, {0.005, 0.005, -0.011}, pa));
  EXPECT_EQ(test::failure_of(
                {"slices", "--service", service.address(), "--scene", "s", "--volume", volume.string()}),
            "");
  const auto created = service.palpation.created();
  ASSERT_EQ(created.size(), 1u);
  const auto& z_m = created[0].modulus().z_m();
  ASSERT_EQ(z_m.size(), 13);
  EXPECT_NEAR(z_m[0], -0.012, 1e-12);
  EXPECT_NEAR(z_m[12], 0.012, 1e-12);
  EXPECT_NEAR(created[0].slices(0).pose().origin_m(2), -0.011, 1e-12);
}

TEST(TouchCommand, ToleranceOfZeroIsAskedFor) {
  test::CommandService service;
  service.palpation.scene = scene_of(0.12, 0.04);
  std::vector<std::string> words{"touch", "--service", service.address(), "--scene", "s"};
  EXPECT_NE(test::failure_of(words), "");
  words.insert(words.end(), {"--tolerance", "0"});
  EXPECT_NE(test::failure_of(words), "");
  const auto opened = service.palpation.opened();
  ASSERT_EQ(opened.size(), 2u);
  EXPECT_FALSE(opened[0].has_tolerance());
  ASSERT_TRUE(opened[1].has_tolerance());
  EXPECT_EQ(opened[1].tolerance().relative(), 0);
}

TEST(TouchCommand, SmallTipSweepsASmallTissue) {
  test::CommandService service;
  service.palpation.scene = scene_of(0.008, 0.004);
  std::vector<std::string> words{"touch", "--service", service.address(), "--scene", "s"};
  const std::string usual = test::failure_of(words);
  EXPECT_NE(usual.find("the tip's reach of 0.008 m"), std::string::npos) << usual;
  EXPECT_TRUE(service.palpation.opened().empty());
  words.insert(words.end(), {"--tip-radius-m", "0.0005"});
  EXPECT_EQ(test::failure_of(words).find("the sweep ends"), std::string::npos);
  EXPECT_EQ(service.palpation.opened().size(), 1u);
}

TEST(WatchCommand, RecordingIsNotPlayedToNobody) {
  EXPECT_FALSE(plays(true, 0));
  EXPECT_TRUE(plays(true, 1));
  EXPECT_FALSE(plays(false, 1));
}

}  // namespace
}  // namespace teletact::client
