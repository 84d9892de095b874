// What slices told of the tissue that they share, kept for those that come.
#include "service/scene/told_slices.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "service/scene/scene.h"
#include "service/scene/state_store.h"
#include "tests/scene/losing_disk.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

std::vector<ToldTissue> told(int place) {
  return {{1, 0, place}};
}

ExplicitModulus with_slices(std::vector<double> slices_m) {
  ExplicitModulus e;
  e.slices_m = std::move(slices_m);
  return e;
}

TEST(ToldSlices, AreOfTheSolidsSlicesButForTheOneInQuestion) {
  ToldSlices slices;
  slices.tell(-0.005, told(1), ""), slices.tell(0, told(2), ""), slices.tell(0.01, told(3), "");
  const ExplicitModulus e = with_slices({-0.005, 0, 0.005});
  const auto beside = slices.beside(e, 0);
  ASSERT_EQ(beside.size(), 1U) << "one at 0.01 was never published";
  EXPECT_DOUBLE_EQ(beside[0].offset_m, -0.005);
  EXPECT_EQ(beside[0].tissues[0].place, 1);
  // A newer one takes the older one's place, to a rounding; one that tells nothing does not.
  slices.tell(-0.005 + 1e-9, told(4), "goes on"), slices.tell(1e-9, {}, "ends");
  EXPECT_EQ(slices.words(), "goes on");
  const auto newer = slices.beside(e, 0.005);
  ASSERT_EQ(newer.size(), 2U);
  EXPECT_EQ(newer[0].tissues[0].place, 4);
  EXPECT_EQ(newer[1].tissues[0].place, 2);
}

TEST(ToldSlices, AreBoundedWhereverAPeerPutsThem) {
  ToldSlices slices;
  std::vector<double> places;
  for (int n = 0; n < 400; ++n) places.push_back(1e-4 * n), slices.tell(places.back(), told(n), "");
  const auto kept = slices.beside(with_slices(places), 1);
  ASSERT_EQ(kept.size(), ToldSlices::kMost);
  EXPECT_EQ(kept.back().tissues[0].place, 399) << "the farthest from the newest go";
}

// What is refused changes nothing.
TEST(ToldSlices, AreChargedToTheirScene) {
  Limits limits = resolved({}, std::uint64_t{1} << 32, std::uint64_t{1} << 32);
  const ToldTissue tissue{1, 0, -1, -0.25, Eigen::MatrixXd::Identity(2, 2), Eigen::VectorXd::Zero(2)};
  constexpr std::uint64_t kOne = sizeof(ToldTissue) + 6 * sizeof(double);
  limits.host_memory_bytes = 5 * kOne / 2, limits.client_memory_share = 1;
  const auto budget = std::make_shared<MemoryBudget>(limits);
  ToldSlices slices({budget, "a"});
  slices.tell(0, {tissue}, "");
  EXPECT_EQ(budget->held(Place::kHost), kOne);
  slices.tell(0, {tissue}, "");
  EXPECT_EQ(budget->held(Place::kHost), kOne);
  slices.tell(0.01, {tissue}, ""), slices.tell(0.02, {tissue}, "");
  EXPECT_EQ(budget->held(Place::kHost), 2 * kOne);
  EXPECT_EQ(slices.beside(with_slices({0, 0.01, 0.02}), 1).size(), 2U);
}

// A solid with two slices, one of which has told.
SceneRecord kept(const ToldTissue& told) {
  ExplicitModulus e;
  e.x_m = {0, 0.02, 0.04}, e.y_m = {0, 0.01, 0.02}, e.z_m = {0, 0.01, 0.02};
  e.youngs_modulus_pa = {1e4, 2e4, 1e4, 2e4, 3e4, 4e4, 3e4, 4e4};
  SceneRecord record;
  record.id = "s", record.geometry = tissue(0.04, 0.02), record.version = 3;
  record.explicit_modulus = e, record.told.slices[0.005] = {told, {0, 1, 30, -2.5}};
  record.told.words = "goes on";
  return record;
}

ToldTissue numbers() {
  ToldTissue t{1, 0, -1, -0.25, Eigen::MatrixXd::Identity(2, 2), Eigen::VectorXd::Constant(2, 0.1)};
  t.information << 400, 30, 30, 90;
  t.elevation_m = 0.01 / 3, t.depth_m = 0.04 / 3, t.beside_m = 0.02;
  return t;
}

SceneRecord read_again(const EncodedScene& files) {
  return decoded(
      files.description, [&](const std::string&) { return files.map; }, Limits{});
}

TEST(ToldSlices, AreKeptWithTheirScene) {
  const Scene scene(read_again(encoded(kept(numbers()))), nullptr, Limits{});
  const SceneRecord again = scene.record();
  ASSERT_EQ(again.told.slices.size(), 1U);
  EXPECT_EQ(again.told.words, "goes on");
  const std::vector<ToldTissue>& tissues = again.told.slices.at(0.005);
  ASSERT_EQ(tissues.size(), 2U);
  EXPECT_EQ(tissues[0].place, -1);
  EXPECT_EQ(tissues[0].log_likelihood, -0.25);
  EXPECT_EQ(tissues[0].information, numbers().information);
  EXPECT_EQ(tissues[0].load, numbers().load);
  EXPECT_EQ(tissues[0].elevation_m, 0.01 / 3);
  EXPECT_EQ(tissues[0].depth_m, 0.04 / 3);
  EXPECT_EQ(tissues[0].beside_m, 0.02);
  EXPECT_EQ(tissues[1].slides, 1);
  EXPECT_EQ(tissues[1].load.size(), 0);
}

// Neither written nor read; the solid is.
TEST(ToldSlices, WhatNoSliceTellsIsNotKept) {
  const auto spoilt = [](const auto& spoil) {
    ToldTissue t = numbers();
    spoil(t);
    const SceneRecord again = read_again(encoded(kept(t)));
    EXPECT_TRUE(again.told.slices.empty());
    EXPECT_EQ(again.explicit_modulus->youngs_modulus_pa, kept(t).explicit_modulus->youngs_modulus_pa);
  };
  spoilt([](ToldTissue& t) { t.log_likelihood = 1; });
  spoilt([](ToldTissue& t) { t.log_likelihood = std::nan(""); });
  spoilt([](ToldTissue& t) { t.load[1] = HUGE_VAL; });
  spoilt([](ToldTissue& t) { t.load[1] = 1e200; });
  spoilt([](ToldTissue& t) { t.information.setZero(), t.load[0] = 1e3; });
  spoilt([](ToldTissue& t) { t.information(1, 1) = -1; });
  spoilt([](ToldTissue& t) { t.information(0, 1) = 60; });
  spoilt([](ToldTissue& t) { t.depth_m = -0.01; });
  spoilt([](ToldTissue& t) { t.depth_m = 0; });
  spoilt([](ToldTissue& t) { t.elevation_m = std::nan(""); });
  spoilt([](ToldTissue& t) { t.beside_m = HUGE_VAL; });
}

// On disk: beyond the map's end, more numbers than a tissue has, another kind of thing.
TEST(ToldSlices, WhatIsNoneOnDiskCostsTheNumbersAlone) {
  const EncodedScene files = encoded(kept(numbers()));
  for (const char* told :
       {R"([[0.005, [[1, 0, -1, 3]]]])", R"([[0.005, [[1, 0, -1, 1000]]]])", R"([[0.005, [[1, 0, -1, -2]]]])",
        R"([[0.005, [[1e300, 0, -1, 0]]]])", R"([[0.005, [[1, 0, -1, 2, [0.01, "deep", 0]]]]])",
        R"([[0.005, [[1, 0, -1, 2, [0.01]]]]])", R"([["here", []]])", R"({"a": 1})"}) {
    nlohmann::json scene = nlohmann::json::parse(files.description);
    scene["tissues"] = nlohmann::json::parse(told), scene.erase("checksum");
    const SceneRecord again = read_again({scene.dump(), files.map_name, files.map});
    EXPECT_TRUE(again.told.slices.empty()) << told;
    EXPECT_EQ(again.explicit_modulus->youngs_modulus_pa.size(), 8U) << told;
  }
  // A file of before names no lengths.
  nlohmann::json before = nlohmann::json::parse(files.description);
  before["tissues"] = nlohmann::json::parse(R"([[0.005, [[1, 0, -1, 2]]]])"), before.erase("checksum");
  const SceneRecord of_before = read_again({before.dump(), files.map_name, files.map});
  ASSERT_EQ(of_before.told.slices.size(), 1U);
  EXPECT_EQ(of_before.told.slices.at(0.005)[0].load, numbers().load);
  EXPECT_EQ(of_before.told.slices.at(0.005)[0].depth_m, 0);
  nlohmann::json scene = nlohmann::json::parse(files.description);
  scene["told_words"] = 3, scene.erase("checksum");
  const SceneRecord again = read_again({scene.dump(), files.map_name, files.map});
  EXPECT_EQ(again.told.slices.size(), 1U);
  EXPECT_EQ(again.told.words, "");
}

// Numbers that no slice finds, under a checksum that is theirs.
TEST(ToldSlices, WhatIsNoNumberOfASliceOnDiskIsNotRead) {
  const auto read_with = [](double last) {  // of the second tissue: its ln likelihood
    EncodedScene files = encoded(kept(numbers()));
    std::memcpy(files.map.data() + files.map.size() - sizeof last, &last, sizeof last);
    std::uint64_t hash = 0xcbf29ce484222325ULL;
    for (const char c : files.map) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3ULL;
    nlohmann::json scene = nlohmann::json::parse(files.description);
    scene["map"]["checksum"] = fmt::format("{:016x}", hash), scene.erase("checksum");
    return read_again({scene.dump(), files.map_name, files.map});
  };
  EXPECT_EQ(read_with(-3).told.slices.size(), 1U);
  for (const double none : {1.0, std::nan(""), -HUGE_VAL})
    EXPECT_TRUE(read_with(none).told.slices.empty()) << none;
}

// A slice told more of a version that was saved already, and the power fails amid the second save.
TEST(ToldSlices, TwoSavesOfAVersionCostNoScene) {
  for (const auto unsynced :
       {LosingDisk::Unsynced::kLost, LosingDisk::Unsynced::kKept, LosingDisk::Unsynced::kByChance})
    for (std::size_t at = 0, failed = 1; failed; ++at) {
      failed = 0;
      const auto disk = std::make_shared<LosingDisk>();
      {
        StateStore store("/state", Limits{}, disk);
        store.save(kept(numbers()));
        ToldTissue more = numbers();
        more.log_likelihood = -7;
        disk->fail_power_at(at);
        try {
          store.save(kept(more));
        } catch (const PowerFailed&) {
          failed = 1;
        }
      }
      disk->restart(unsynced, static_cast<unsigned>(at));
      StateStore store("/state", Limits{}, disk);
      std::vector<SceneRecord> scenes;
      store.load([&](const SceneRecord& record) { scenes.push_back(record); });
      ASSERT_EQ(scenes.size(), 1U) << at;
      EXPECT_EQ(scenes[0].told.slices.size(), 1U) << at;
    }
}

}  // namespace
}  // namespace teletact::service
