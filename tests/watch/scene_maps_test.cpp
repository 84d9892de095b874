// A scene's maps as the page draws them, put together from what Observe sends.
#include "client/watch/scene_maps.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "client/watch/view.h"
#include "tests/watch/web_peer.h"

namespace teletact::client {
namespace {

constexpr double kStepM = 0.001;

template <class Value>
v1::ObservedMap part(const char* name, std::size_t begin, std::uint32_t nx, std::uint32_t ny,
                     const std::vector<Value>& values) {
  v1::ObservedMap out;
  out.set_version(3);
  v1::Map& map = *out.mutable_map();
  map.set_name(name);
  map.mutable_grid()->add_size(nx), map.mutable_grid()->add_size(ny);
  map.mutable_grid()->add_origin_m((static_cast<double>(begin) + 0.5) * kStepM);
  map.mutable_grid()->add_origin_m(0.5 * kStepM);
  for (int axis = 0; axis < 2; ++axis) map.mutable_grid()->add_spacing_m(kStepM);
  map.mutable_values()->set_dtype(sizeof(Value) == 1 ? v1::DATA_TYPE_UINT8 : v1::DATA_TYPE_FLOAT32);
  map.mutable_values()->set_data(values.data(), values.size() * sizeof(Value));
  return out;
}

v1::Scene scene(std::initializer_list<std::uint64_t> windows) {
  v1::Scene out;
  for (const double size_m : {6 * kStepM, 2 * kStepM}) out.mutable_geometry()->add_size_m(size_m);
  for (const std::uint64_t id : windows) out.add_windows()->set_window_id(id);
  return out;
}

// An array of a slot; empty: it has none of that name.
template <class Value>
std::vector<Value> values(const Slot& slot, const char* name, std::size_t nth = 0) {
  const std::string bytes = frame(1, {std::make_shared<const std::string>(slot.bytes(Channel::kMap))});
  const test::WebSlot read = test::decoded(bytes).slots.begin()->second;
  std::size_t seen = 0;
  for (const auto& array : read.json.value("arrays", nlohmann::json::array())) {
    if (array["name"] != name || seen++ != nth) continue;
    std::vector<Value> out(array["shape"][0].get<std::size_t>() * array["shape"][1].get<std::size_t>());
    std::memcpy(out.data(), read.data.data() + array["at"].get<std::size_t>(), out.size() * sizeof(Value));
    return out;
  }
  return {};
}

TEST(SceneMaps, PartsAreDrawnWhereTheyLieEachOverThoseBefore) {
  SceneMaps maps;
  maps.take(scene({1}));
  ASSERT_TRUE(maps.take(part<float>("youngs_modulus", 1, 3, 2, {1, 2, 3, 4, 5, 6})));
  ASSERT_TRUE(maps.take(part<float>("youngs_modulus", 3, 3, 2, {30, 40, 50, 60, 70, 80})));
  ASSERT_TRUE(maps.take(part<std::uint8_t>("valid", 5, 1, 2, {1, 0})));
  ASSERT_TRUE(maps.take(part<float>("youngs_modulus_log_std", 0, 1, 2, {0.1F, 0.2F})));
  EXPECT_TRUE(maps.cells_changed());
  EXPECT_FALSE(maps.cells_changed()) << "once";
  EXPECT_FALSE(maps.images_changed());
  const Slot cells = maps.cells();
  EXPECT_EQ(values<float>(cells, "modulus_pa"),
            (std::vector<float>{0, 1, 2, 30, 40, 50, 0, 4, 5, 60, 70, 80}));
  EXPECT_EQ(values<std::uint8_t>(cells, "valid"),
            (std::vector<std::uint8_t>{0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0}));
  const auto deviation = values<float>(cells, "log_std");
  EXPECT_EQ(deviation[6], 0.2F);
  EXPECT_TRUE(std::isnan(deviation[1])) << "what is not known is no number";
}

TEST(SceneMaps, ImagesAreOfWindowsAndTheNewestIsDrawnLast) {
  SceneMaps maps;
  maps.take(scene({7, 8}));
  const auto image = [](std::uint64_t window, std::uint8_t grey) {
    v1::ObservedMap out = part<std::uint8_t>("b_mode", 0, 2, 2, std::vector<std::uint8_t>(4, grey));
    out.set_window_id(window);
    return out;
  };
  ASSERT_TRUE(maps.take(image(7, 70)) && maps.take(image(8, 80)) && maps.take(image(7, 71)));
  EXPECT_TRUE(maps.images_changed());
  EXPECT_EQ(values<std::uint8_t>(maps.images(), "b_mode").at(0), 80);
  EXPECT_EQ(values<std::uint8_t>(maps.images(), "b_mode", 1).at(0), 71);
  maps.take(scene({7}));
  EXPECT_TRUE(maps.images_changed()) << "a window is gone";
  EXPECT_EQ(values<std::uint8_t>(maps.images(), "b_mode").at(0), 71);
  EXPECT_TRUE(values<std::uint8_t>(maps.images(), "b_mode", 1).empty());
}

TEST(SceneMaps, WhatIsMalformedChangesNothing) {
  SceneMaps maps;
  maps.take(scene({1}));
  const v1::ObservedMap good = part<float>("youngs_modulus", 0, 2, 2, {1, 2, 3, 4});
  const auto refused = [&](auto change) {
    v1::ObservedMap bad = good;
    change(*bad.mutable_map());
    return !maps.take(bad) && !maps.cells_changed();
  };
  for (const double wrong : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity(), 1e-300})
    EXPECT_TRUE(refused([&](v1::Map& m) { m.mutable_grid()->set_spacing_m(0, wrong); })) << wrong;
  for (const double wrong : {-1.0, 0.3e-3, 5.5e-3, 1e300, std::nan("")})
    EXPECT_TRUE(refused([&](v1::Map& m) { m.mutable_grid()->set_origin_m(0, wrong); })) << wrong;
  for (const std::uint32_t wrong : {0U, 3U, 4'000'000'000U})
    EXPECT_TRUE(refused([&](v1::Map& m) { m.mutable_grid()->set_size(0, wrong); })) << wrong;
  EXPECT_TRUE(refused([](v1::Map& m) { m.set_name("colour"); }));
  EXPECT_TRUE(refused([](v1::Map& m) { m.mutable_values()->set_dtype(v1::DATA_TYPE_FLOAT64); }));
  EXPECT_TRUE(refused([](v1::Map& m) { m.mutable_values()->mutable_data()->pop_back(); }));
  EXPECT_TRUE(refused([](v1::Map& m) { m.mutable_grid()->add_size(2); }));
  EXPECT_TRUE(maps.take(good));
}

TEST(SceneMaps, OfASceneOfAnotherWidthTheFormerAreNotShown) {
  SceneMaps maps;
  const auto shown = [&] { return values<float>(maps.cells(), "modulus_pa"); };
  const v1::ObservedMap cells = part<float>("youngs_modulus", 0, 2, 2, {1, 2, 3, 4});
  maps.take(scene({1}));
  ASSERT_TRUE(maps.take(cells) && maps.cells_changed());
  maps.take(scene({1}));
  EXPECT_FALSE(maps.cells_changed());
  EXPECT_FALSE(shown().empty());
  v1::Scene wider = scene({1});
  wider.mutable_geometry()->set_size_m(0, 8 * kStepM);
  maps.take(wider);
  EXPECT_TRUE(maps.cells_changed()) << "what is shown is gone";
  EXPECT_TRUE(shown().empty());
  maps.take(scene({1}));
  ASSERT_TRUE(maps.take(cells) && maps.cells_changed());
  wider.mutable_youngs_modulus();  // which is none
  maps.take(wider);
  EXPECT_TRUE(maps.cells_changed() && maps.images_changed());
  EXPECT_TRUE(shown().empty());
}

TEST(SceneMaps, OfAWholeSceneAreItsOwn) {
  SceneMaps maps;
  v1::Scene whole = scene({});
  *whole.mutable_youngs_modulus() = part<float>("", 0, 3, 1, {1, 2, 3}).map();
  *whole.add_b_mode() = part<std::uint8_t>("b_mode", 0, 2, 1, {9, 9}).map();
  maps.take(whole);
  EXPECT_EQ(values<float>(maps.cells(), "modulus_pa"), (std::vector<float>{1, 2, 3}));
  EXPECT_EQ(values<std::uint8_t>(maps.cells(), "valid"), (std::vector<std::uint8_t>{1, 1, 1}))
      << "none says it is not";
  EXPECT_EQ(values<std::uint8_t>(maps.images(), "b_mode").size(), 2U);
}

// The page knows an image by its number: another service may call another one the same.
TEST(SceneMaps, NoTwoImagesHaveOneNumberAndTheOldestGiveWay) {
  SceneMaps maps;
  const auto drawn = [&] {
    const std::string bytes =
        frame(1, {std::make_shared<const std::string>(maps.images().bytes(Channel::kBMode))});
    const test::WebSlot slot = test::decoded(bytes).slots.begin()->second;
    std::set<std::uint64_t> out;
    for (const auto& array : slot.json["arrays"]) out.insert(array["drawn"].get<std::uint64_t>());
    return out;
  };
  const auto put = [&](std::uint64_t window, std::uint32_t nodes) {
    v1::ObservedMap image = part<std::uint8_t>("b_mode", 0, nodes, 1, std::vector<std::uint8_t>(nodes));
    image.set_window_id(window);
    return maps.take(image);
  };
  ASSERT_TRUE(put(1, 2));
  const auto before = drawn();
  maps.clear();
  ASSERT_TRUE(put(1, 2));
  EXPECT_NE(drawn(), before);
  EXPECT_FALSE(put(2, SceneMaps::kMaxNodes + 1));
  for (std::uint64_t window = 2; window <= SceneMaps::kMaxImages + 2; ++window) ASSERT_TRUE(put(window, 2));
  EXPECT_EQ(drawn().size(), SceneMaps::kMaxImages);
  for (std::uint64_t window = 1; window <= SceneMaps::kMaxImageBytes / SceneMaps::kMaxNodes + 1; ++window)
    ASSERT_TRUE(put(window, SceneMaps::kMaxNodes));
  EXPECT_LE(drawn().size(), SceneMaps::kMaxImageBytes / SceneMaps::kMaxNodes);
}

// What the page gets of an observation, and of one whose stream has ended.
TEST(SceneMaps, TheViewPassesOnWhatIsNew) {
  View view;
  View::Seen seen;
  view.news(seen);
  v1::Observation first;
  *first.mutable_scene() = scene({1});
  *first.add_maps() = part<float>("youngs_modulus", 0, 2, 2, {1, 2, 3, 4});
  v1::DeformedSurface& surface = *first.mutable_surface();
  surface.add_x_m(0.001), surface.add_x_m(0.002), surface.add_z_m(0);
  surface.mutable_displacement_m()->set_dtype(v1::DATA_TYPE_FLOAT32);
  surface.mutable_displacement_m()->set_data(std::string(2 * sizeof(float), '\0'));
  view.take_observed(first);
  std::set<std::uint32_t> channels;
  const auto news = [&] {
    channels.clear();
    for (const auto& [channel, slot] : test::decoded(frame(1, view.news(seen))).slots)
      channels.insert(channel);
    return channels;
  };
  const auto number = [](Channel channel) { return static_cast<std::uint32_t>(channel); };
  EXPECT_EQ(news(), (std::set{number(Channel::kScene), number(Channel::kMap), number(Channel::kSurface)}));
  v1::Observation nothing;
  view.take_observed(nothing);
  EXPECT_EQ(news(), std::set<std::uint32_t>());
  surface.mutable_displacement_m()->mutable_data()->pop_back();
  first.clear_scene(), first.clear_maps();
  view.take_observed(first);
  EXPECT_EQ(news(), std::set<std::uint32_t>()) << "malformed";
  view.look_away();
  EXPECT_EQ(news(), std::set{number(Channel::kSurface)}) << "the maps stay until there are others";
  *first.mutable_scene() = scene({1});
  view.take_observed(first);
  EXPECT_EQ(news(), (std::set{number(Channel::kScene), number(Channel::kMap), number(Channel::kBMode)}));
  view.look_away(true);
  EXPECT_EQ(news(), (std::set{number(Channel::kScene), number(Channel::kMap), number(Channel::kBMode),
                              number(Channel::kSurface)}))
      << "of another scene nothing is known yet";
}

}  // namespace
}  // namespace teletact::client
