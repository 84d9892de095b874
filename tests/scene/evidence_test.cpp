// What a window was made of stays with it, on disk too, and each doubt does to a touch what the table says.
#include "service/scene/stitched_map.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <string>
#include <thread>

#include "service/base/warning.h"
#include "service/scene/errors.h"
#include "service/scene/scenes.h"
#include "service/touch_plane/touch_session.h"
#include "tests/scene/create_scene.h"
#include "tests/scene/published.h"
#include "tests/scene/windows.h"
#include "tests/support/environment.h"

namespace teletact::service {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr double kDepthM = 0.04, kWindowM = 0.03;

// Two windows that adjoin, the first of them with these warnings.
std::shared_ptr<Scene> doubted(const std::vector<std::string>& warnings) {
  auto scene = std::make_shared<Scene>("s", tissue(0.12, kDepthM), versions());
  WindowEstimate window = window_of(homogeneous(10e3), 0.03, kWindowM, kDepthM);
  window.evidence.warnings = warnings;
  scene->publish(window);
  scene->publish(window_of(homogeneous(10e3), 0.06, kWindowM, kDepthM));
  return scene;
}

TouchAnswer touched(const std::shared_ptr<Scene>& scene, double x_m) {
  TouchSession session(scene, {}, nullptr);
  return session.solve({x_m, 0.001});
}

TEST(Evidence, EachFlagDoesToATouchWhatTheTableSays) {
  using Flags = std::vector<std::string>;
  for (const WarningKind& kind : kWarnings) {
    const std::string name = kind.name;
    const TouchAnswer answer = touched(doubted({name + ": such and such"}), 0.045);
    const bool wrong = name == "wrong-force" || name == "misfit" || name == "image" || name == "axis";
    EXPECT_EQ(answer.status, wrong ? TouchStatus::kDegraded : TouchStatus::kOk) << name;
    EXPECT_NE(answer.warning.find(name), std::string::npos) << answer.warning;
    EXPECT_EQ(answer.window_flags, Flags{name});
    EXPECT_LT(answer.contact.force_n[1], 0) << name;
  }
  const TouchAnswer sure = touched(doubted({}), 0.045);
  EXPECT_EQ(sure.status, TouchStatus::kOk);
  EXPECT_EQ(sure.warning, "");
  EXPECT_EQ(sure.window_flags, Flags{});
  const TouchAnswer neighbour = touched(doubted({"misfit: such and such"}), 0.08);
  EXPECT_EQ(neighbour.status, TouchStatus::kOk) << "its own flags count, not its neighbour's";
}

// What `name` finds from `begin` to `end` of a file of the project.
std::set<std::string> names_in(const char* file, const char* begin, const char* end, const char* name) {
  std::ifstream in(fs::path(test::required_environment("TELETACT_SOURCE_DIR")) / file);
  const std::string all{std::istreambuf_iterator<char>(in), {}};
  const std::size_t from = all.find(begin);
  EXPECT_NE(from, std::string::npos) << file << " has no " << begin;
  const std::string part = all.substr(std::min(from, all.size()), all.find(end, from) - from);
  const std::regex pattern(name);
  std::set<std::string> names;
  for (std::sregex_iterator at(part.begin(), part.end(), pattern), last; at != last; ++at)
    names.insert((*at)[1]);
  return names;
}

TEST(Evidence, GuideAndContractListTheWarningsOfTheTable) {
  std::set<std::string> all, degrading;
  for (const WarningKind& kind : kWarnings) {
    all.insert(kind.name);
    if (kind.degrades) degrading.insert(kind.name);
  }
  const char* const guide = "docs/guide/recorded-data.md";
  EXPECT_EQ(names_in(guide, "## What the warnings mean", "**Touch", "(?:- |, )`([a-z_-]+)`(?=[,:])"), all);
  EXPECT_EQ(names_in(guide, "**Touch on a window with warnings:**", "make it DEGRADED", "`([a-z_-]+)`"),
            degrading);
  EXPECT_EQ(names_in("proto/teletact/v1/elastography.proto", "Names, of the modulus",
                     "repeated string warnings", "[:,]\\s(?:\\s*// )?([a-z_-]+)(?=[,;]| \\()"),
            all);
}

TEST(Evidence, OfADoubtedWindowNothingIsForeseen) {
  TouchSession session(doubted({"wrong-force: such and such"}), {}, nullptr);
  EXPECT_FALSE(session.solve({0.045, -0.001}).foreseen.has_value());
  EXPECT_TRUE(session.solve({0.08, -0.001}).foreseen.has_value());
}

TEST(Evidence, AWindowWithoutNeighboursIsLoneUntilItHasOne) {
  auto scene = std::make_shared<Scene>("s", tissue(0.2, kDepthM), versions());
  const auto publish = [&](double x_m) {
    return scene->publish(window_of(homogeneous(10e3), x_m, kWindowM, kDepthM)).warnings;
  };
  const auto lone = [&](double x_m) {
    return touched(scene, x_m).window_flags == std::vector<std::string>{name_of(WarningFlag::kLone)};
  };
  ASSERT_EQ(publish(0.03).size(), 1U);
  EXPECT_EQ(flag_of(publish(0.03)[0]), name_of(WarningFlag::kLone)) << "itself before is no neighbour";
  EXPECT_TRUE(lone(0.045));
  EXPECT_EQ(publish(0.1).size(), 1U) << "a neighbour adjoins";
  EXPECT_TRUE(lone(0.045) && lone(0.115));
  EXPECT_TRUE(publish(0.06).empty());
  EXPECT_FALSE(lone(0.045) || lone(0.075));
  EXPECT_TRUE(lone(0.115));
}

// Valid where `measured` says so of the depth.
WindowEstimate measured_where(const std::function<bool(double)>& measured) {
  WindowEstimate window = window_of(homogeneous(10e3), 0.03, 0.06, kDepthM);
  for (std::size_t n = 0; n < window.valid.size(); ++n) window.valid[n] = measured(window.grid.y_m(n));
  return window;
}

TouchStatus at_layer(const WindowEstimate& window, double depth_m) {
  auto scene = std::make_shared<Scene>("s", tissue(0.12, kDepthM), versions());
  scene->publish(window);
  TouchOptions options;
  options.layer_depth_m = depth_m;
  TouchSession session(scene, options, nullptr);
  return session.solve({0.06, session.layer().depth_m + 0.002}).status;
}

TEST(Evidence, TissueNotMeasuredUnderTheTouchedLayerCounts) {
  const WindowEstimate above = measured_where([](double y_m) { return y_m < 0.020; });
  EXPECT_EQ(at_layer(above, 0), TouchStatus::kOk);
  EXPECT_EQ(at_layer(above, 0.030), TouchStatus::kDegraded);
  const WindowEstimate below = measured_where([](double y_m) { return y_m > 0.022; });
  EXPECT_EQ(at_layer(below, 0), TouchStatus::kDegraded);
  EXPECT_EQ(at_layer(below, 0.030), TouchStatus::kOk);
}

TEST(Evidence, ARefreshedNeighbourKeepsWhenItWasTakenIn) {
  auto scene = std::make_shared<Scene>("s", tissue(0.12, kDepthM), versions());
  const auto first = Clock::now() - std::chrono::seconds(9), second = first + std::chrono::seconds(4);
  for (const auto& [x_m, taken_in] : {std::pair{0.03, first}, {0.06, second}}) {
    WindowEstimate window = window_of(homogeneous(10e3), x_m, kWindowM, kDepthM);
    window.evidence.taken_in = taken_in;
    scene->publish(window);
  }
  const std::uint64_t before = touched(scene, 0.045).model_version;
  while (scene->refresh_stale_window()) {
  }
  const TouchAnswer refreshed = touched(scene, 0.045);
  EXPECT_GT(refreshed.model_version, before);
  EXPECT_EQ(refreshed.taken_in, first);
  EXPECT_EQ(touched(scene, 0.075).taken_in, second);
}

TEST(Evidence, ScenesHeldOtherwiseThanAnEstimateAssumesTakeNone) {
  for (EdgeSupport Supports::*edge : {&Supports::bottom, &Supports::left, &Supports::right, &Supports::top}) {
    SceneGeometry geometry = tissue(0.12, kDepthM);
    geometry.supports.left = EdgeSupport::kFixed;  // so that none floats away
    geometry.supports.*edge = edge == &Supports::bottom ? EdgeSupport::kFree : EdgeSupport::kFixed;
    const Scene scene("s", geometry, versions());
    try {
      scene.check_window(0.03, 0.06);
      ADD_FAILURE() << "published";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind, ErrorKind::kPrecondition);
      EXPECT_NE(std::string(error.what()).find("held"), std::string::npos) << error.what();
    }
  }
}

class EvidenceOnDisk : public testing::Test {
 protected:
  EvidenceOnDisk() {
    WindowEstimate window = window_of(homogeneous(10e3), 0.03, kWindowM, kDepthM);
    for (std::size_t n = 0; n < window.valid.size(); ++n)
      window.log_deviation.push_back(static_cast<float>(0.1 + window.grid.y_m(n)));
    window.evidence = {
        {"misfit: such and such", "noise: much"}, 0, 0.0011, 0.02, 0.07, 10e3, 0.8, 0, Clock::now(), 0.09};
    Scenes scenes(directory);
    publish_into(scenes, create_scene(scenes, "a", tissue(0.12, kDepthM), std::nullopt), window);
    kept = *scenes.find("a")->snapshot()->windows[0]->evidence;
    deviation = scenes.find("a")->snapshot()->map->log_deviation();
  }
  ~EvidenceOnDisk() override { fs::remove_all(directory); }

  const fs::path directory = fs::temp_directory_path() / ("teletact-evidence-" + std::to_string(getpid()));
  WindowEvidence kept;
  std::vector<float> deviation;
};

TEST_F(EvidenceOnDisk, SurvivesTheService) {
  EXPECT_NEAR(kept.log_deviation, 0.12, 0.002);  // at half depth
  EXPECT_NEAR(kept.measured_share, 1, 0.05);
  Scenes scenes(directory);
  scenes.restore();
  const auto scene = scenes.find("a");
  const auto window = scene->snapshot()->windows.at(0);
  ASSERT_TRUE(window->evidence);
  EXPECT_EQ(window->evidence->warnings, kept.warnings);
  EXPECT_EQ(window->evidence->log_deviation, kept.log_deviation);
  EXPECT_EQ(window->evidence->correlation_m, 0.0011);
  EXPECT_EQ(window->evidence->force_relative_deviation, 0.02);
  EXPECT_EQ(window->evidence->area_relative_deviation, 0.07);
  EXPECT_EQ(window->evidence->common_deviation, 0.09);
  EXPECT_EQ(window->evidence->background_modulus_pa, 10e3);
  EXPECT_EQ(window->evidence->quality, 0.8);
  EXPECT_EQ(window->evidence->measured_share, kept.measured_share);
  EXPECT_EQ(window->evidence->taken_in, Clock::time_point()) << "another process' clock";
  const std::vector<float>& read = scene->snapshot()->map->log_deviation();
  ASSERT_EQ(read.size(), deviation.size());
  for (std::size_t n = 0; n < read.size(); ++n)
    ASSERT_TRUE(read[n] == deviation[n] || (std::isnan(read[n]) && std::isnan(deviation[n]))) << n;
  EXPECT_NEAR(scene->snapshot()->map->measured_log_deviation(0.045, 0.02), 0.12, 0.001);
  EXPECT_EQ(touched(scene, 0.045).status, TouchStatus::kDegraded) << "it is as wrong as before";
}

// As a service wrote it whose deviations did not hold what the force and the area leave open.
TEST_F(EvidenceOnDisk, DeviationsOfBeforeAreWidenedByTheForces) {
  const fs::path file = directory / "scenes" / "a" / "scene.json";
  nlohmann::json scene = nlohmann::json::parse(std::ifstream(file));
  scene["windows"][0]["evidence"].erase("common_deviation");
  scene.erase("checksum");
  std::ofstream(file) << scene;
  Scenes scenes(directory);
  scenes.restore();
  const auto restored = scenes.find("a")->snapshot();
  const WindowEvidence& e = *restored->windows.at(0)->evidence;
  EXPECT_NEAR(e.common_deviation, std::hypot(0.02, 0.07), 1e-12);
  EXPECT_NEAR(e.log_deviation, std::hypot(kept.log_deviation, 0.02, 0.07), 1e-9);
  EXPECT_NEAR(restored->map->measured_log_deviation(0.045, 0.02), std::hypot(0.12, 0.02, 0.07), 0.001);
}

// As a service wrote it that kept neither evidence nor deviations.
TEST_F(EvidenceOnDisk, TheFormatBeforeIsStillRead) {
  const fs::path folder = directory / "scenes" / "a";
  nlohmann::json scene = nlohmann::json::parse(std::ifstream(folder / "scene.json"));
  const fs::path map = folder / scene["map"]["file"].get<std::string>();
  const std::size_t cells = scene["cells"];
  fs::resize_file(map, cells * (sizeof(float) + 1));
  std::ifstream in(map, std::ios::binary);
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (std::istreambuf_iterator<char> c(in), end; c != end; ++c)
    hash = (hash ^ static_cast<unsigned char>(*c)) * 0x100000001b3ULL;
  char sum[17];
  std::snprintf(sum, sizeof sum, "%016lx", static_cast<unsigned long>(hash));
  scene["map"]["checksum"] = sum;
  scene["format"] = 1;
  scene["windows"][0].erase("evidence");
  scene.erase("checksum");
  std::ofstream(folder / "scene.json") << scene;
  Scenes scenes(directory);
  scenes.restore();
  ASSERT_EQ(scenes.list().size(), 1U);
  const TouchAnswer answer = touched(scenes.find("a"), 0.045);
  EXPECT_EQ(answer.status, TouchStatus::kOk) << answer.warning;
  EXPECT_EQ(answer.window_flags, std::vector<std::string>{name_of(WarningFlag::kLone)});
  EXPECT_TRUE(std::isnan(scenes.find("a")->snapshot()->map->measured_log_deviation(0.045, 0.02)));
}

}  // namespace
}  // namespace teletact::service
