// Which device images which scene.
#include "service/imaging_plane/scene_lanes.h"

#include <gtest/gtest.h>

#include "tests/scene/create_scene.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

class Placing : public testing::Test {
 protected:
  std::shared_ptr<Scene> scene(const char* id) {
    return create_scene(scenes, id, tissue(0.05, 0.02), std::nullopt);
  }
  Scenes scenes{""};
  SceneLanes places;
};

TEST_F(Placing, ASceneGoesToTheDeviceWithTheFewestAndStaysThere) {
  const auto a = scene("a"), b = scene("b");
  EXPECT_EQ(places.place(a, {{true, 2}, {true, 1}, {true, 3}}), 1U);
  EXPECT_EQ(places.place(a, {{true, 0}, {true, 9}, {true, 0}}), 1U);
  EXPECT_EQ(places.place(b, {{true, 2}, {true, 0}, {true, 3}}), 0U) << "the other one has a scene";
  EXPECT_EQ(places.moved(), 0U);
}

TEST_F(Placing, DeletedScenesDoNotCount) {
  places.place(scene("a"), {{}, {}});
  scenes.remove("a");
  const auto b = scene("b"), c = scene("c");
  EXPECT_EQ(places.place(b, {{}, {}}), 0U);
  EXPECT_EQ(places.place(c, {{}, {}}), 1U);
}

TEST_F(Placing, SceneMovesToAWorkingDeviceAndStays) {
  const auto a = scene("a");
  EXPECT_EQ(places.place(a, {{true, 0, 0}, {true, 1, 1}, {true, 2, 2}}), 0U);
  EXPECT_EQ(places.place(a, {{false, 0, 0}, {false, 1, 1}, {false, 2, 2}}), 0U) << "it waits for its own";
  EXPECT_EQ(places.moved(), 0U);
  EXPECT_TRUE(places.is_at(a, 0));
  EXPECT_EQ(places.place(a, {{false, 0, 0}, {false, 1, 1}, {true, 2, 2}}), 2U);
  EXPECT_FALSE(places.is_at(a, 0));
  EXPECT_TRUE(places.is_at(a, 2));
  EXPECT_EQ(places.place(a, {{true, 0, 0}, {true, 1, 1}, {true, 2, 2}}), 2U)
      << "back again, it takes what comes anew";
  EXPECT_EQ(places.moved(), 1U);
}

// One that works on several pairs at once has as many places.
TEST_F(Placing, ADevicesPlacesAreItsScenes) {
  const std::vector<SceneLanes::Lane> lanes{{true, 0, 0}, {true, 0, 1}, {true, 0, 0}};
  const auto a = scene("a"), b = scene("b"), c = scene("c");
  EXPECT_EQ(places.place(a, lanes), 0U);
  EXPECT_EQ(places.place(b, lanes), 1U);
  EXPECT_EQ(places.place(c, lanes), 2U);
  EXPECT_TRUE(places.is_at(a, 0) && places.is_at(b, 1) && places.is_at(c, 0));
  EXPECT_EQ(places.place(c, {{false, 0, 0}, {true, 0, 1}, {false, 0, 0}}), 1U) << "its device has failed";
  EXPECT_TRUE(places.is_at(c, 1));
}

TEST_F(Placing, WithoutASceneItIsTheLeastLoadedThatWorks) {
  EXPECT_EQ(places.place(nullptr, {{false, 0}, {true, 2}, {true, 1}}), 2U);
  EXPECT_EQ(places.place(nullptr, {{false, 0}, {false, 2}}), 0U);
}

}  // namespace
}  // namespace teletact::service
