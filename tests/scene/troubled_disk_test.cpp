// A full or failing disk stops keeping, nothing else; who makes scenes never waits for it.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <functional>
#include <future>
#include <mutex>
#include <set>
#include <thread>

#include "service/scene/errors.h"
#include "service/scene/scenes.h"
#include "service/touch_plane/touch_session.h"
#include "tests/scene/create_scene.h"
#include "tests/scene/losing_disk.h"
#include "tests/scene/published.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

using Unsynced = LosingDisk::Unsynced;

const Files::Path kState = "/var/lib/state";

std::size_t scenes_after_a_power_failure(const std::shared_ptr<LosingDisk>& disk) {
  disk->restart(Unsynced::kLost, 0);
  Scenes scenes(kState, {}, disk);
  scenes.restore();
  return scenes.list().size();
}

class TroubledDisk : public testing::Test {
 protected:
  static void settle(Scenes& scenes) { scenes.wait_until_kept(); }
  static Published publish(Scenes& scenes, double x_m) {
    const Published published =
        publish_into(scenes, scenes.find("a"), window_of(homogeneous(10e3), x_m, 0.03, 0.02));
    settle(scenes);
    return published;
  }
  static bool says_so(const Published& published) {
    return std::any_of(published.warnings.begin(), published.warnings.end(),
                       [](const std::string& warning) { return flag_of(warning) == "state"; });
  }
  const std::shared_ptr<LosingDisk> disk = std::make_shared<LosingDisk>();
};

TEST_F(TroubledDisk, AFullOneStopsKeepingNotPublishingAndIsSaid) {
  std::uint64_t last = 0;
  {
    Scenes scenes(kState, {}, disk);
    create_scene(scenes, "a", tissue(0.09, 0.02), std::nullopt);
    EXPECT_FALSE(says_so(publish(scenes, 0)));
    disk->fail_from(0, ENOSPC);
    publish(scenes, 0.03);
    const Published unkept = publish(scenes, 0.06);
    EXPECT_TRUE(says_so(unkept));
    TouchSession session(scenes.find("a"), {}, nullptr);
    EXPECT_EQ(session.solve({0.075, 0.001}).status, TouchStatus::kOk);
    try {
      create_scene(scenes, "b", tissue(0.09, 0.02), std::nullopt);
      ADD_FAILURE() << "acknowledged, and it would not survive";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind, ErrorKind::kExhausted);
      EXPECT_NE(std::string(error.what()).find("free"), std::string::npos) << error.what();
    }
    EXPECT_EQ(scenes.list().size(), 1U);
    disk->work_again();
    last = publish(scenes, 0.06).version;
    EXPECT_FALSE(says_so(publish(scenes, 0.06)));
    create_scene(scenes, "b", tissue(0.09, 0.02), std::nullopt);
  }
  disk->restart(Unsynced::kLost, 0);
  Scenes scenes(kState, {}, disk);
  scenes.restore();
  ASSERT_EQ(scenes.list().size(), 2U);
  EXPECT_EQ(scenes.find("a")->snapshot()->windows.size(), 3U);
  EXPECT_GT(scenes.find("a")->snapshot()->version, last);
}

TEST_F(TroubledDisk, AFullOneIsNotFilledFurtherByWhatIsNotKept) {
  Scenes scenes(kState, {}, disk);
  create_scene(scenes, "a", tissue(0.09, 0.02), std::nullopt);
  publish(scenes, 0);
  const std::filesystem::path folder = std::filesystem::path(kState) / "scenes" / "a";
  for (std::size_t at = 0; at < 12; ++at) {
    disk->fail_from(at, ENOSPC);
    publish(scenes, 0.03);
    EXPECT_TRUE(says_so(publish(scenes, 0.06)));
    disk->work_again();
    const std::string description = disk->read(folder / "scene.json", 1 << 20);
    std::uint64_t newest = 0;
    std::vector<std::string> maps;
    for (const std::string& name : disk->list(folder)) {
      EXPECT_FALSE(name.ends_with(".tmp")) << name << " " << at;
      if (!name.starts_with("map-")) continue;
      const std::uint64_t version = std::stoull(name.substr(4));
      if (version > newest) newest = version, maps.clear();
      if (version == newest) maps.push_back(name);
    }
    for (const std::string& name : maps)
      EXPECT_NE(description.find("\"" + name + "\""), std::string::npos)
          << "nothing names " << name << " " << at;
  }
}

TEST_F(TroubledDisk, ADeletionThatIsRefusedLosesNothing) {
  for (const int number : {ENOSPC, EIO})
    for (std::size_t at = 0; at < 8; ++at) {
      const auto own = std::make_shared<LosingDisk>();
      bool refused = false;
      {
        Scenes scenes(kState, {}, own);
        create_scene(scenes, "a", tissue(0.09, 0.02), std::nullopt);
        own->fail_from(at, number, number == EIO);
        try {
          scenes.remove("a");
        } catch (const Error& error) {
          refused = true;
          EXPECT_EQ(error.kind, ErrorKind::kUnavailable);
        }
        EXPECT_EQ(scenes.list().size(), refused ? 1U : 0U);
        own->work_again();
      }
      EXPECT_EQ(scenes_after_a_power_failure(own), refused ? 1U : 0U) << number << " " << at;
    }
}

// Whose service died as the disk filled up: another one took its folder.
class FilledUp : public LosingDisk {
 public:
  std::shared_ptr<void> lock(const Path& path, bool wait) override {
    if (fills_up) fail_from(0, ENOSPC);
    return LosingDisk::lock(path, wait);
  }
  bool fills_up = false;
};

TEST(KeepingState, WhoTookOverAFullDiskPublishesOnceThereIsRoom) {
  const auto disk = std::make_shared<FilledUp>();
  {
    Scenes first(kState, {}, disk);
    create_scene(first, "a", tissue(0.09, 0.02), std::nullopt);
  }
  disk->fills_up = true;
  Scenes second(kState, {}, disk, nullptr, tissue_models(), true);
  second.restore();
  const auto publish = [&] {
    publish_into(second, second.find("a"), window_of(homogeneous(10e3), 0.03, 0.03, 0.02));
  };
  EXPECT_THROW(publish(), Error);
  second.wait_until_kept();
  EXPECT_THROW(publish(), Error);
  second.wait_until_kept();
  disk->work_again();
  EXPECT_THROW(publish(), Error) << "there was no version before";
  second.wait_until_kept();
  publish();
}

TEST_F(TroubledDisk, AnyFailureRefusesTheSceneAlone) {
  for (const int number : {ENOSPC, EIO})
    for (std::size_t at = 0; at < 18; ++at) {
      const auto own = std::make_shared<LosingDisk>();
      bool made = false;
      {
        Scenes scenes(kState, {}, own);
        create_scene(scenes, "a", tissue(0.09, 0.02), std::nullopt);
        own->fail_from(at, number, true);
        try {
          create_scene(scenes, "b", tissue(0.09, 0.02), std::nullopt);
          made = true;
        } catch (const Error& error) {
          EXPECT_EQ(error.kind, number == ENOSPC ? ErrorKind::kExhausted : ErrorKind::kUnavailable);
        }
        EXPECT_EQ(scenes.list().size(), made ? 2U : 1U);
        own->work_again();
        if (!made) create_scene(scenes, "b", tissue(0.09, 0.02), std::nullopt);
      }
      EXPECT_EQ(scenes_after_a_power_failure(own), 2U) << number << " " << at;
    }
}

TEST(KeepingState, SceneBeyondMemoryIsNotWrittenOver) {
  const auto disk = std::make_shared<LosingDisk>();
  const ExplicitModulus large{uniform_coordinates(0, 0.1, 200), uniform_coordinates(0, 0.03, 20),
                              std::vector<double>(4000, 10e3)};
  {
    Scenes first(kState, {}, disk);
    create_scene(first, "a", tissue(0.1, 0.03), large);
  }
  {
    Limits limits;
    limits.host_memory_bytes = limits.device_memory_bytes = 1000;
    Scenes small(kState, limits, disk, std::make_shared<MemoryBudget>(limits));
    small.restore();
    EXPECT_TRUE(small.list().empty());
    try {
      create_scene(small, "a", tissue(0.1, 0.03), std::nullopt);
      ADD_FAILURE() << "written over";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind, ErrorKind::kAlreadyExists);
    }
  }
  Scenes again(kState, {}, disk);
  again.restore();
  ASSERT_EQ(again.list().size(), 1U);
  EXPECT_EQ(again.list()[0]->snapshot()->modulus->youngs_modulus_pa.size(), 4000U);
}

// One that cannot be read for a while.
class UnreadableDisk final : public LosingDisk {
 public:
  std::string read(const Path& path, std::uint64_t most) override {
    if (unreadable && path.filename() == "scene.json") throw FileError("read", path, EIO);
    return LosingDisk::read(path, most);
  }
  bool unreadable = false;
};

TEST(KeepingState, ASceneThatCannotBeReadNowStaysWhereItIs) {
  const auto disk = std::make_shared<UnreadableDisk>();
  {
    Scenes first(kState, {}, disk);
    create_scene(first, "a", tissue(0.1, 0.03), std::nullopt);
  }
  disk->unreadable = true;
  {
    Scenes blind(kState, {}, disk);
    blind.restore();
    EXPECT_TRUE(blind.list().empty());
    EXPECT_THROW(create_scene(blind, "a", tissue(0.1, 0.03), std::nullopt), Error) << "written over";
  }
  disk->unreadable = false;
  Scenes again(kState, {}, disk);
  again.restore();
  EXPECT_EQ(again.list().size(), 1U);
}

// Which threads the disk was touched on.
class WatchedDisk final : public Files {
 public:
  bool exists(const Path& p) override { return note(), disk_.exists(p); }
  std::vector<std::string> list(const Path& p) override { return note(), disk_.list(p); }
  std::uint64_t size(const Path& p) override { return note(), disk_.size(p); }
  std::string read(const Path& p, std::uint64_t most) override { return note(), disk_.read(p, most); }
  void make_folder(const Path& p) override { note(), disk_.make_folder(p); }
  void write(const Path& p, std::span<const char> bytes) override { note(), disk_.write(p, bytes); }
  void sync(const Path& p) override { note(), disk_.sync(p); }
  void rename(const Path& a, const Path& b) override { note(), disk_.rename(a, b); }
  void remove(const Path& p) override { note(), disk_.remove(p); }
  std::shared_ptr<void> lock(const Path& p, bool wait) override { return disk_.lock(p, wait); }
  void keep_private(const Path& p) override { note(), disk_.keep_private(p); }
  bool touched_by(std::thread::id thread) {
    const std::lock_guard lock(mutex_);
    return threads_.contains(thread);
  }
  std::atomic<bool> stuck{false};

 private:
  void note() {
    while (stuck) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    const std::lock_guard lock(mutex_);
    threads_.insert(std::this_thread::get_id());
  }
  std::mutex mutex_;
  std::set<std::thread::id> threads_;
  LosingDisk disk_;
};

TEST(KeepingState, IsNeverDoneByWhoMakesScenesAndPublishes) {
  const auto disk = std::make_shared<WatchedDisk>();
  Scenes scenes(kState, {}, disk);
  Workers fair;
  Publisher publisher(scenes, fair);
  std::set<std::thread::id> workers;
  std::thread imaging([&] {
    workers.insert(std::this_thread::get_id());
    disk->stuck = true;  // a disk that does not come back
    std::promise<std::shared_ptr<Scene>> made;
    auto kept = made.get_future();
    scenes.make("a", tissue(0.09, 0.02), std::nullopt,
                [&](const std::shared_ptr<Scene>& scene, std::exception_ptr) { made.set_value(scene); });
    EXPECT_NE(kept.wait_for(std::chrono::seconds(0)), std::future_status::ready) << "before it is on disk";
    EXPECT_THROW(scenes.find("a"), Error);
    disk->stuck = false;
    const auto scene = kept.get();
    disk->stuck = true;
    for (int k = 0; k < 3; ++k)
      fair.run({},
               [&] {
                 workers.insert(std::this_thread::get_id());
                 publisher.publish(scene, window_of(homogeneous(10e3), 0.03 * k, 0.03, 0.02), {});
               })
          .future.get();
    disk->stuck = false;
  });
  imaging.join();
  fair.stop();
  scenes.wait_until_kept();
  for (const std::thread::id worker : workers) EXPECT_FALSE(disk->touched_by(worker));
}

}  // namespace
}  // namespace teletact::service
