// Scenes on disk. One file: every case needs the same folder, clock of versions and way to touch what came
// back.
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <future>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "service/scene/errors.h"
#include "service/scene/scenes.h"
#include "service/touch_plane/touch_session.h"
#include "tests/scene/create_scene.h"
#include "tests/scene/published.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

namespace fs = std::filesystem;

class StateOnDisk : public testing::Test {
 protected:
  StateOnDisk() {
    static int count = 0;
    directory = fs::temp_directory_path() /
                ("teletact-state-" + std::to_string(getpid()) + "-" + std::to_string(count++));
  }
  ~StateOnDisk() override { fs::remove_all(directory); }

  static Published publish(Scenes& scenes, const std::string& id, double x_m, double modulus_pa) {
    return publish_into(scenes, scenes.find(id), window_of(homogeneous(modulus_pa), x_m, 0.03, 0.03));
  }
  static double force_n(Scenes& scenes, const std::string& id, double x_m) {
    TouchSession session(scenes.find(id), {}, nullptr);
    return session.solve({x_m, 0.003}).contact.force_n[1];
  }
  fs::path directory;
};

// Whatever the process's mask is, and whatever an earlier version has left.
TEST_F(StateOnDisk, IsItsOwnersAlone) {
  const auto mode = [](const fs::path& path) {
    struct stat found {};
    EXPECT_EQ(::lstat(path.c_str(), &found), 0) << path;
    return found.st_mode & 07777;
  };
  const auto expect_private = [&] {
    std::size_t files = 0;
    for (const auto& entry : fs::recursive_directory_iterator(directory)) {
      EXPECT_EQ(mode(entry.path()), entry.is_directory() ? 0700U : 0600U) << entry.path();
      files += entry.is_regular_file();
    }
    EXPECT_GE(files, 4U) << "lock, versions, a scene and its map";
  };
  const mode_t mask = ::umask(0);
  {
    Scenes scenes(directory);
    create_scene(scenes, "a", tissue(0.12, 0.03), std::nullopt);
    publish(scenes, "a", 0.03, 10e3);
    expect_private();
    EXPECT_EQ(mode(directory), 0700U);
  }
  ::umask(mask);
  fs::create_directories(directory / "set-aside" / "b-1");
  for (const auto& entry : fs::recursive_directory_iterator(directory))
    ASSERT_EQ(::chmod(entry.path().c_str(), entry.is_directory() ? 0755 : 0644), 0);
  const fs::path beside = directory.string() + "-beside";
  std::ofstream(beside) << "somebody's";
  ASSERT_EQ(::chmod(beside.c_str(), 0644), 0);
  ASSERT_EQ(::chmod(directory.c_str(), 0755), 0);
  fs::create_symlink(beside, directory / "scenes" / "a" / "link");
  {
    Scenes scenes(directory);
    fs::remove(directory / "scenes" / "a" / "link");
    expect_private();
  }
  EXPECT_EQ(mode(beside), 0644U) << "a link is not followed";
  EXPECT_EQ(mode(directory), 0755U) << "the folder that was given is its owner's to say";
  fs::remove(beside);
}

TEST_F(StateOnDisk, ScenesSurviveWithTheirForceAndVersionsGoOn) {
  double before_n = 0, explicit_n = 0;
  std::uint64_t version = 0, window = 0;
  ExplicitModulus e{uniform_coordinates(0, 0.06, 30), uniform_coordinates(0, 0.02, 10),
                    std::vector<double>(300, 7e3)};
  {
    Scenes scenes(directory);
    create_scene(scenes, "a", tissue(0.12, 0.03), std::nullopt);
    create_scene(scenes, "b", tissue(0.06, 0.02), e);
    publish(scenes, "a", 0.03, 10e3);
    window = publish(scenes, "a", 0.06, 20e3).window_id;
    version = scenes.find("a")->snapshot()->version;
    before_n = force_n(scenes, "a", 0.05);
    explicit_n = force_n(scenes, "b", 0.03);
  }
  Scenes scenes(directory);
  scenes.restore();
  ASSERT_EQ(scenes.list().size(), 2U);
  EXPECT_EQ(scenes.find("a")->snapshot()->version, version);
  EXPECT_EQ(scenes.find("a")->snapshot()->windows.size(), 2U);
  EXPECT_NEAR(force_n(scenes, "a", 0.05), before_n, 1e-9);
  EXPECT_NEAR(force_n(scenes, "b", 0.03), explicit_n, 1e-9);
  const Published next = publish(scenes, "a", 0.09, 10e3);
  EXPECT_GT(next.version, version);
  EXPECT_GT(next.window_id, window);
}

TEST_F(StateOnDisk, NodesThatBeginBelowZeroByRoundingSurvive) {
  ExplicitModulus e{uniform_coordinates(0, 0.06, 30), uniform_coordinates(0, 0.02, 10),
                    std::vector<double>(300, 7e3)};
  e.x_m.front() = -1e-18;
  {
    Scenes scenes(directory);
    create_scene(scenes, "a", tissue(0.06, 0.02), e);
  }
  Scenes scenes(directory);
  scenes.restore();
  EXPECT_EQ(scenes.list().size(), 1U);
}

TEST_F(StateOnDisk, ImagesOfWindowsSurviveWhereTheyLie) {
  BMode image{{4, 3, 0.5e-3, 1e-3, 1e-3, 2e-3}, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 255}};
  {
    Scenes scenes(directory);
    create_scene(scenes, "a", tissue(0.2, 0.03), std::nullopt);
    WindowEstimate window = window_of(homogeneous(1e4), 0.03, 0.03, 0.03);
    window.b_mode = image;
    publish_into(scenes, scenes.find("a"), window);
    publish(scenes, "a", 0.1, 1e4);  // one that has none
  }
  Scenes scenes(directory);
  scenes.restore();
  const auto windows = scenes.find("a")->snapshot()->windows;
  ASSERT_EQ(windows.size(), 2U);
  ASSERT_TRUE(windows[0]->b_mode);
  image.grid.origin_x_m += 0.03;
  EXPECT_EQ(windows[0]->b_mode->grid, image.grid);
  EXPECT_EQ(windows[0]->b_mode->grey, image.grey);
  EXPECT_FALSE(windows[1]->b_mode);
}

TEST_F(StateOnDisk, VersionsAreNotReusedAfterDeletionOrLoss) {
  std::uint64_t version = 0;
  {
    Scenes scenes(directory);
    create_scene(scenes, "a", tissue(0.12, 0.03), std::nullopt);
    version = publish(scenes, "a", 0.03, 10e3).version;
    scenes.remove("a");
    EXPECT_THROW(scenes.find("a"), Error);
    create_scene(scenes, "a", tissue(0.12, 0.03), std::nullopt);
    const auto again = publish(scenes, "a", 0.03, 10e3).version;
    EXPECT_GT(again, version);
    version = again;
  }
  fs::remove_all(directory / "scenes");  // as if it had died before it wrote them
  Scenes scenes(directory);
  scenes.restore();
  create_scene(scenes, "a", tissue(0.12, 0.03), std::nullopt);
  EXPECT_GT(publish(scenes, "a", 0.03, 10e3).version, version);
}

TEST_F(StateOnDisk, DamagedSceneIsSetAsideAndTheOthersLive) {
  {
    Scenes scenes(directory);
    for (const char* id : {"cut-map", "flipped-map", "bad-json", "no-map", "whole"}) {
      create_scene(scenes, id, tissue(0.12, 0.03), std::nullopt);
      publish(scenes, id, 0.03, 10e3);
    }
  }
  const auto map_of = [&](const char* id) {
    for (const auto& entry : fs::directory_iterator(directory / "scenes" / id))
      if (entry.path().extension() == ".raw") return entry.path();
    return fs::path();
  };
  fs::resize_file(map_of("cut-map"), 100);
  std::fstream(map_of("flipped-map"), std::ios::in | std::ios::out | std::ios::binary)
      .seekp(1000)
      .put('\xff')
      .put('\x7f');
  std::ofstream(directory / "scenes" / "bad-json" / "scene.json") << "{ \"format\": 1, ";
  fs::remove(map_of("no-map"));
  std::ofstream(directory / "versions.json") << "rubbish";
  Scenes scenes(directory);
  scenes.restore();
  ASSERT_EQ(scenes.list().size(), 1U);
  EXPECT_EQ(scenes.list()[0]->id(), "whole");
  const auto restored = scenes.find("whole")->snapshot()->windows[0]->version;
  EXPECT_GT(publish(scenes, "whole", 0.06, 10e3).version, restored);
  std::size_t aside = 0;
  for ([[maybe_unused]] const auto& entry : fs::directory_iterator(directory / "set-aside")) ++aside;
  EXPECT_EQ(aside, 4U);
}

// GIVEN scenes that are kept, WHEN a service starts whose models refuse them, THEN they stay where they are,
// their names are taken, and they are back once the models take them.
TEST_F(StateOnDisk, ScenesThatTheModelsRefuseStayAndComeBack) {
  class Refusing final : public TouchModels {
   public:
    std::vector<Layer> layers(const SceneGeometry&) const override { return {Layer{}}; }
    double context_m() const override { return 0; }
    std::shared_ptr<const TouchModel> of_window(const WantedModel&) const override {
      throw std::invalid_argument("geometry.supports: not here");
    }
    std::shared_ptr<const TouchModel> of_modulus(const SceneGeometry&, const ExplicitModulus&,
                                                 const MemoryAccount&) const override {
      throw std::invalid_argument("modulus.z_m: not here");
    }
  };
  double before_n = 0;
  {
    Scenes scenes(directory);
    create_scene(scenes, "given", tissue(0.06, 0.02),
                 ExplicitModulus{uniform_coordinates(0, 0.06, 30), uniform_coordinates(0, 0.02, 10),
                                 std::vector<double>(300, 7e3)});
    create_scene(scenes, "imaged", tissue(0.12, 0.03), std::nullopt);
    publish(scenes, "imaged", 0.03, 10e3);
    before_n = force_n(scenes, "imaged", 0.05);
  }
  {
    Scenes scenes(directory, {}, machine_files(), {}, std::make_shared<const Refusing>());
    scenes.restore();
    EXPECT_TRUE(scenes.list().empty());
    for (const char* id : {"given", "imaged"}) try {
        create_scene(scenes, id, tissue(0.12, 0.03), std::nullopt);
        ADD_FAILURE() << id << " was written over";
      } catch (const Error& error) {
        EXPECT_EQ(error.kind, ErrorKind::kAlreadyExists) << error.what();
      }
  }
  Scenes scenes(directory);
  scenes.restore();
  EXPECT_EQ(scenes.list().size(), 2U);
  EXPECT_EQ(force_n(scenes, "imaged", 0.05), before_n);
}

// What the files may say when a hand has been at them, or a disk has lost the last writes.
TEST_F(StateOnDisk, VersionsNeverGoBackWhateverTheFileSays) {
  std::uint64_t last = 0;
  for (const char* text :
       {"{\"first_unused\": 3}", "{\"first_unused\": -5}", "{\"first_unused\": 1e300}", "{",
        "{\"first_unused\": \"7\"}", "{\"first_unused\": 18446744073709551615}", ""}) {
    Scenes scenes(directory);
    scenes.restore();
    if (scenes.list().empty()) create_scene(scenes, "a", tissue(0.12, 0.03), std::nullopt);
    const std::uint64_t version = publish(scenes, "a", 0.03, 10e3).version;
    EXPECT_GT(version, last) << text;
    last = scenes.find("a")->snapshot()->version;
    std::ofstream(directory / "versions.json") << text;  // for the next round
  }
}

TEST_F(StateOnDisk, WindowsThatCannotBeAreSetAside) {
  const auto image = [](std::size_t nx, std::size_t ny, double spacing_m) -> nlohmann::json {
    return {{"nodes", {nx, ny}}, {"origin_m", {0, 0}}, {"spacing_m", {spacing_m, 1e-3}}};
  };
  const std::vector<std::pair<const char*, nlohmann::json>> changes{
      {"begin_m", -1.0},
      {"end_m", 1e9},
      {"begin_m", 0.119},
      {"id", 0},
      {"end_m", nullptr},
      {"version", 1000000},
      {"version", "latest"},
      {"b_mode", 7},
      {"b_mode", image(1, 1, 1e-3)},
      {"b_mode", image(200, 200, 1e-3)},  // more than the file has
      {"b_mode", image(std::size_t{1} << 33, std::size_t{1} << 33, 1e-3)},
      {"b_mode", image(2, 2, -1e-3)}};
  {
    Scenes scenes(directory);
    for (std::size_t k = 0; k < changes.size(); ++k) {
      create_scene(scenes, "s" + std::to_string(k), tissue(0.12, 0.03), std::nullopt);
      publish(scenes, "s" + std::to_string(k), 0.03, 10e3);
    }
  }
  for (std::size_t k = 0; k < changes.size(); ++k) {
    const fs::path file = directory / "scenes" / ("s" + std::to_string(k)) / "scene.json";
    nlohmann::json scene = nlohmann::json::parse(std::ifstream(file));
    scene["windows"][0][changes[k].first] = changes[k].second;
    scene.erase("checksum");  // a hand that knows of it
    std::ofstream(file) << scene;
  }
  Scenes scenes(directory);
  scenes.restore();
  EXPECT_TRUE(scenes.list().empty()) << scenes.list()[0]->id();
}

// A process that publishes until it is killed, and tells each version.
[[noreturn]] void publish_until_killed(const fs::path& directory, int tell) {
  spdlog::set_level(spdlog::level::off);
  Scenes scenes(directory);
  scenes.restore();
  if (scenes.list().empty()) create_scene(scenes, "a", tissue(0.02, 0.01), std::nullopt);
  for (int k = 0;; ++k) {
    const auto scene = scenes.find("a");
    const std::uint64_t version =
        publish_into(scenes, scene, window_of(homogeneous(1e4), 0.002 * (k % 4), 0.01, 0.01)).version;
    if (k == 0) scenes.wait_until_kept();  // each life leaves something
    if (write(tell, &version, sizeof(version)) != sizeof(version)) std::_Exit(1);
  }
}

TEST_F(StateOnDisk, RandomKillsRepeatNoVersionAndLoseNoScene) {
  std::mt19937 random(11);
  std::uint64_t last = 0;
  for (int round = 0; round < 12; ++round) {
    int pipe_ends[2];
    ASSERT_EQ(pipe(pipe_ends), 0);
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) publish_until_killed(directory, pipe_ends[1]);
    close(pipe_ends[1]);
    std::uint64_t version = 0;
    const unsigned before_the_kill = 1 + random() % 5;  // publications, then within a later one's writing
    unsigned told = 0;
    const auto hear = [&] {
      if (read(pipe_ends[0], &version, sizeof(version)) != sizeof(version)) return false;
      EXPECT_GT(version, last);
      last = std::max(last, version);
      return ++told, true;
    };
    while (told < before_the_kill && hear()) {
    }
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 60000));
    kill(child, SIGKILL);
    while (hear()) {
    }
    close(pipe_ends[0]);
    int status = 0;
    waitpid(child, &status, 0);
    EXPECT_TRUE(WIFSIGNALED(status)) << "round " << round << ": it ended by itself";
    EXPECT_GE(told, before_the_kill);
  }
  Scenes scenes(directory);
  scenes.restore();
  ASSERT_EQ(scenes.list().size(), 1U);
  EXPECT_GT(scenes.list()[0]->snapshot()->version, 0U) << "nothing was written: the kills came too early";
  EXPECT_FALSE(fs::exists(directory / "set-aside"));
}

TEST_F(StateOnDisk, UnusableDirectoryIsOneClearLine) {
  std::ofstream(directory.string()) << "a file";
  EXPECT_THROW(Scenes{directory}, std::runtime_error);
  fs::remove(directory);
  Scenes first(directory);
  try {
    Scenes second(directory);
    FAIL() << "two services share a state";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("in use"), std::string::npos);
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
  }
}

// What was published last is on disk before the other one has the folder.
TEST_F(StateOnDisk, WhoStandsByHasTheFolderOnceItIsLetGo) {
  Scenes first(directory);
  const auto scene = create_scene(first, "s", tissue(0.12, 0.03), std::nullopt);
  publish(first, "s", 0.03, 10e3);
  Scenes second(directory, {}, machine_files(), nullptr, tissue_models(), true);
  auto restored = std::async(std::launch::async, [&] { second.restore(); });
  EXPECT_EQ(restored.wait_for(std::chrono::milliseconds(100)), std::future_status::timeout);
  first.let_go();
  ASSERT_EQ(restored.wait_for(std::chrono::minutes(1)), std::future_status::ready);
  restored.get();
  ASSERT_EQ(second.list().size(), 1U);
  EXPECT_EQ(second.list()[0]->snapshot()->version, scene->snapshot()->version);
  EXPECT_EQ(second.list()[0]->snapshot()->windows.size(), 1U);
  EXPECT_EQ(first.find("s"), scene) << "it is touched on";
  try {
    first.remove("s");
    FAIL() << "taken from a disk that is another's";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind, ErrorKind::kUnavailable);
  }
  EXPECT_FALSE(scene->deleted());
  EXPECT_THROW(Scenes({}, {}, machine_files(), nullptr, tissue_models(), true), std::runtime_error);
}

TEST(Scenes, IdsAndLimitsAreChecked) {
  Limits limits;
  limits.max_scenes = 3, limits.max_scene_elements = 100, limits.max_scene_columns = 20;
  Scenes scenes({}, limits);
  EXPECT_THROW(create_scene(scenes, "../x", tissue(0.1, 0.03), std::nullopt), std::invalid_argument);
  EXPECT_THROW(create_scene(scenes, std::string(65, 'a'), tissue(0.1, 0.03), std::nullopt),
               std::invalid_argument);
  create_scene(scenes, "a", tissue(0.1, 0.03), std::nullopt);
  EXPECT_THROW(create_scene(scenes, "a", tissue(0.1, 0.03), std::nullopt), Error);
  const auto chosen = create_scene(scenes, "", tissue(0.1, 0.03), std::nullopt);
  EXPECT_NE(chosen->id(), "");
  ExplicitModulus e{uniform_coordinates(0, 0.1, 15), uniform_coordinates(0, 0.03, 10),
                    std::vector<double>(150, 1e4)};
  EXPECT_THROW(create_scene(scenes, "b", tissue(0.1, 0.03), e), Error);  // 150 elements of 100
  create_scene(scenes, "c", tissue(0.1, 0.03), std::nullopt);
  EXPECT_THROW(create_scene(scenes, "d", tissue(0.1, 0.03), std::nullopt), Error);
  scenes.remove("c");
  EXPECT_THROW(scenes.remove("c"), Error);
}

TEST(Scenes, ModulusAndGeometryAreChecked) {
  Scenes scenes({});
  const auto refused = [&](SceneGeometry g, ExplicitModulus e) {
    EXPECT_THROW(create_scene(scenes, "x", g, e), std::invalid_argument);
    EXPECT_TRUE(scenes.list().empty());
  };
  const ExplicitModulus good{uniform_coordinates(0, 0.1, 5), uniform_coordinates(0, 0.03, 3),
                             std::vector<double>(15, 1e4)};
  for (const double modulus_pa : {-1.0, 0.0, std::nan(""), HUGE_VAL}) {
    ExplicitModulus e = good;
    e.youngs_modulus_pa[7] = modulus_pa;
    refused(tissue(0.1, 0.03), e);
  }
  ExplicitModulus e = good;
  e.x_m[2] = e.x_m[1];
  refused(tissue(0.1, 0.03), e);
  refused(tissue(0.2, 0.03), good);  // does not span it
  for (const double nu : {0.5, -0.1, 0.7, std::nan("")}) {
    SceneGeometry g = tissue(0.1, 0.03);
    g.poisson_ratio = nu;
    refused(g, good);
  }
  SceneGeometry floating = tissue(0.1, 0.03);
  floating.supports.bottom = EdgeSupport::kFree;
  refused(floating, good);
}

}  // namespace
}  // namespace teletact::service
