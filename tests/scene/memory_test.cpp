// What scenes hold: nothing where nothing is published, what a publication changes, and all of it in the name
// of the client who made them.
#include <gtest/gtest.h>
#include <malloc.h>

#include <filesystem>
#include <functional>
#include <vector>

#include "service/base/limits.h"
#include "service/base/memory.h"
#include "service/device/device.h"
#include "service/scene/errors.h"
#include "service/scene/scenes.h"
#include "service/touch_plane/touch_session.h"
#include "tests/scene/create_scene.h"
#include "tests/scene/losing_disk.h"
#include "tests/scene/published.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

constexpr std::uint64_t kMiB = 1 << 20;

std::shared_ptr<MemoryBudget> budget_of(std::uint64_t host_bytes, double share = 1) {
  Limits limits;
  limits.host_memory_bytes = host_bytes, limits.device_memory_bytes = host_bytes;
  limits.client_memory_share = share;
  return std::make_shared<MemoryBudget>(limits);
}

SceneGeometry largest() {
  return tissue(Limits{}.max_scene_width_m, Limits{}.max_scene_depth_m);
}

// In use by malloc, large blocks included.
std::uint64_t allocated() {
  const auto info = mallinfo2();
  return info.uordblks + info.hblkhd;
}

ExplicitModulus uniform_modulus(std::size_t columns, std::size_t rows) {
  return {uniform_coordinates(0, 0.1, columns), uniform_coordinates(0, 0.03, rows),
          std::vector<double>(columns * rows, 10e3)};
}

TEST(SceneMemory, LargestEmptySceneTakesUnderAMebibyte) {
  const auto budget = budget_of(1024 * kMiB);
  const std::uint64_t before = allocated();
  Scenes scenes({}, {}, machine_files(), budget);
  for (std::uint64_t k = 0; k < Limits{}.max_scenes; ++k)
    create_scene(scenes, "s" + std::to_string(k), largest(), std::nullopt, "anna");
  EXPECT_LT(budget->held(Place::kHost), Limits{}.max_scenes * kMiB);
  EXPECT_LT(allocated() - before, Limits{}.max_scenes * kMiB);
}

TEST(SceneMemory, APublicationSharesWhatItDoesNotChange) {
  const auto budget = budget_of(4096 * kMiB);
  Scene scene("s", tissue(1.0, 0.05), versions(), {}, {budget, "anna", "s"});
  for (const double x_m : {0.0, 0.3, 0.6}) scene.publish(window_of(homogeneous(10e3), x_m, 0.03, 0.05));
  const auto before = scene.snapshot();
  const auto moduli_pa = before->map->youngs_modulus_pa();
  const auto held = [&] {
    for (const MemoryUse& use : budget->uses())
      if (use.kind == "maps") return use.bytes;
    return std::uint64_t{0};
  };
  const std::uint64_t of_before = held();
  scene.publish(window_of(homogeneous(20e3), 0.6, 0.03, 0.05));
  const auto after = scene.snapshot();
  EXPECT_EQ(after->map->cells().shared_with(before->map->cells()), 3U) << "one block at 0, two at 0.3 m";
  EXPECT_LT(held(), 1.5 * static_cast<double>(of_before));
  EXPECT_EQ(before->map->youngs_modulus_pa(), moduli_pa) << "who holds the old map sees the old map";
  EXPECT_NEAR(after->map->mean_modulus_pa(0.61, 0.62, 0.01, 0.02), 20e3, 1);
  EXPECT_NEAR(after->map->mean_modulus_pa(0.01, 0.02, 0.01, 0.02), 10e3, 1);
}

TEST(SceneMemory, EverythingIsGivenBackWithTheScene) {
  const auto budget = budget_of(4096 * kMiB);
  {
    Scenes scenes({}, {}, machine_files(), budget);
    create_scene(scenes, "a", tissue(0.1, 0.03), uniform_modulus(50, 15), "anna");
    const auto b = create_scene(scenes, "b", tissue(0.2, 0.03), std::nullopt, "berta");
    publish_into(scenes, b, window_of(homogeneous(10e3), 0.05, 0.04, 0.03));
    EXPECT_GT(budget->held(Place::kHost, "anna"), 50U * 15 * sizeof(double));
    EXPECT_GT(budget->held(Place::kHost, "berta"), 0U);
    scenes.remove("a");
    EXPECT_EQ(budget->held(Place::kHost, "anna"), 0U);
  }
  EXPECT_EQ(budget->held(Place::kHost), 0U);
  EXPECT_TRUE(budget->uses().empty());
}

TEST(SceneMemory, ClientAtItsShareIsRefusedAlone) {
  const auto budget = budget_of(40 * kMiB, 0.1);
  Scenes scenes({}, {}, machine_files(), budget);
  const auto create = [&](const std::string& id, std::size_t columns, const std::string& client) {
    return create_scene(scenes, id, tissue(0.1, 0.03), uniform_modulus(columns, 15), client);
  };
  create("a", 50, "anna");
  const std::uint64_t held = budget->held(Place::kHost);
  EXPECT_THROW(create("large", 400, "anna"), MemoryRefused);
  EXPECT_EQ(budget->held(Place::kHost), held);
  EXPECT_THROW(scenes.find("large"), Error);
  EXPECT_NO_THROW(create("large", 50, "anna")) << "the name was not taken by the refused one";
  EXPECT_NO_THROW(create("b", 50, "berta"));
}

TEST(SceneMemory, ARestoredSceneIsTheServicesOwn) {
  const auto folder =
      std::filesystem::temp_directory_path() / ("teletact-memory-" + std::to_string(getpid()));
  {
    Scenes scenes(folder);
    create_scene(scenes, "a", tissue(0.1, 0.03), uniform_modulus(50, 15));
  }
  const auto budget = budget_of(40 * kMiB, 0.001);  // shares of 40 KiB
  {
    Scenes scenes(folder, {}, machine_files(), budget);
    scenes.restore();
    EXPECT_NO_THROW(scenes.find("a"));
    EXPECT_GT(budget->held(Place::kHost, ""), 0U);
  }
  std::filesystem::remove_all(folder);
}

// Tells of each file that is read.
class ReadDisk final : public LosingDisk {
 public:
  std::string read(const Path& file, std::uint64_t most) override {
    if (on_read) on_read(file);
    return LosingDisk::read(file, most);
  }
  std::function<void(const Path&)> on_read;
};

class RestoredScenes : public testing::Test {
 protected:
  RestoredScenes() {
    Scenes scenes("/state", {}, disk);
    for (const char* id : {"a", "b", "c"})
      create_scene(scenes, id, tissue(0.1, 0.03), uniform_modulus(50, 15));
  }
  const std::shared_ptr<ReadDisk> disk = std::make_shared<ReadDisk>();
};

std::uint64_t restoring(const MemoryBudget& budget) {
  for (const MemoryUse& use : budget.uses())
    if (use.kind == "restoring") return use.bytes;
  return 0;
}

TEST_F(RestoredScenes, AreReadOneAfterAnotherAndChargedMeanwhile) {
  const auto budget = budget_of(40 * kMiB);
  Scenes scenes("/state", {}, disk, budget);
  std::vector<std::size_t> there;
  disk->on_read = [&](const Files::Path& file) {
    if (file.extension() != ".raw") return;
    there.push_back(scenes.list().size());
    EXPECT_GT(restoring(*budget), 2 * 50 * 15 * sizeof(double));
  };
  scenes.restore();
  EXPECT_EQ(there, (std::vector<std::size_t>{0, 1, 2}));
  EXPECT_EQ(restoring(*budget), 0U);
}

TEST_F(RestoredScenes, ThatFindNoRoomAreNotReadAndStayOnDisk) {
  Scenes scenes("/state", {}, disk, budget_of(kMiB / 64));
  bool read = false;
  disk->on_read = [&](const Files::Path& file) { read = read || file.extension() == ".raw"; };
  scenes.restore();
  EXPECT_FALSE(read);
  EXPECT_TRUE(scenes.list().empty());
  EXPECT_TRUE(disk->exists("/state/scenes/a/scene.json"));
}

// A touch whose columns find no room bears no force and says so; the compliance is touched as before.
TEST(SceneMemory, ATouchWithoutRoomFailsWithTheSizesAndOthersGoOn) {
  const auto modulus = uniform_modulus(50, 15);
  std::uint64_t fixed = 0;
  {
    const auto budget = budget_of(4096 * kMiB);
    auto scene = std::make_shared<Scene>("s", tissue(0.1, 0.03), modulus, versions(), Limits{},
                                         MemoryAccount{budget, "anna", "s"});
    fixed = budget->held(Place::kHost);
  }
  const auto budget = budget_of(fixed + kMiB / 4);
  auto scene = std::make_shared<Scene>("s", tissue(0.1, 0.03), modulus, versions(), Limits{},
                                       MemoryAccount{budget, "anna", "s"});
  TouchOptions by_gradients;
  by_gradients.path = SolvePath::kGradients;
  const TouchAnswer refused = TouchSession(scene, by_gradients, Device::open()).solve({0.05, 0.003});
  EXPECT_EQ(refused.status, TouchStatus::kFailed);
  EXPECT_NE(refused.warning.find("bytes for"), std::string::npos) << refused.warning;
  EXPECT_EQ(refused.contact.force_n[1], 0);
  EXPECT_EQ(TouchSession(scene, {}, nullptr).solve({0.05, 0.003}).status, TouchStatus::kOk);
}

}  // namespace
}  // namespace teletact::service
