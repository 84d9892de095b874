#include "client/link/scenes.h"

#include <gtest/gtest.h>

#include <utility>

namespace teletact::client {
namespace {

using Extents = std::vector<std::pair<double, double>>;

v1::Window window(double begin_x_m, double end_x_m, bool touchable = true) {
  v1::Window out;
  out.mutable_covers()->set_begin_x_m(begin_x_m);
  out.mutable_covers()->set_end_x_m(end_x_m);
  out.set_touchable(touchable);
  return out;
}

Extents extents_of(const std::vector<v1::Window>& windows) {
  v1::Scene scene;
  for (const v1::Window& one : windows) *scene.add_windows() = one;
  Extents out;
  for (const Extent& extent : touchable_extents(scene)) out.emplace_back(extent.begin_x_m, extent.end_x_m);
  return out;
}

TEST(TouchableExtents, AWindowWithinAnotherShortensNothing) {
  EXPECT_EQ(extents_of({window(0, 0.1), window(0.02, 0.05)}), (Extents{{0, 0.1}}));
  EXPECT_EQ(extents_of({window(0, 0.1), window(0.02, 0.05), window(0.08, 0.14)}), (Extents{{0, 0.14}}));
}

TEST(TouchableExtents, EndWhereNothingCanBeTouched) {
  EXPECT_EQ(extents_of({window(0.06, 0.12), window(0, 0.06)}), (Extents{{0, 0.12}}));
  EXPECT_EQ(extents_of({window(0, 0.05), window(0.05, 0.06, false), window(0.06, 0.1)}),
            (Extents{{0, 0.05}, {0.06, 0.1}}));
  EXPECT_EQ(extents_of({}), Extents{});
}

}  // namespace
}  // namespace teletact::client
