// Scenes that were acknowledged survive a power failure at any moment.
#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "service/scene/state_store.h"
#include "tests/scene/losing_disk.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

using Unsynced = LosingDisk::Unsynced;

const Files::Path kState = "/var/lib/state";

SceneRecord record(const std::string& id, std::uint64_t version) {
  SceneRecord r;
  r.id = id;
  r.geometry = tissue(0.01, 0.005);
  r.version = version;
  const StitchedMap map(r.geometry);
  r.map_modulus_pa.assign(map.nx() * map.ny(), static_cast<float>(1000 + version));
  r.map_states.assign(map.nx() * map.ny(), CellState::kMeasured);
  r.map_log_deviation.assign(map.nx() * map.ny(), 0.1F);
  r.windows.push_back({1, version, 0, 0.01, std::make_shared<WindowEvidence>()});
  return r;
}

// What was promised.
struct Promised {
  std::map<std::string, std::uint64_t> least;    // scenes that must be there, of this version or a newer one
  std::map<std::string, std::uint64_t> written;  // the newest that was begun
  std::set<std::string> gone, uncertain;         // deletions: done; begun
  std::uint64_t used = 0;                        // versions that were handed out
};

// A life of the service: everything that it does to its folder.
void live(const std::shared_ptr<Files>& disk, Promised& promised) {
  StateStore store(kState, {}, disk);
  const std::uint64_t first = store.first_version();
  EXPECT_GT(first, promised.used);
  promised.used = first + 3;
  const auto save = [&](const std::string& id, std::uint64_t version) {
    promised.written[id] = version;
    promised.gone.erase(id);
    store.save(record(id, version));
    promised.least[id] = version;
    promised.uncertain.erase(id);
  };
  save("a", first);
  save("b", first + 1);
  save("a", first + 2);
  promised.uncertain.insert("b");
  promised.least.erase("b");
  store.remove("b");
  promised.uncertain.erase("b");
  promised.gone.insert("b");
  store.reserve_versions(store.reserved_versions() + StateStore::kVersionBlock);
  save("b", first + 3);
}

void expect_kept(const std::shared_ptr<Files>& disk, const Promised& promised, const std::string& when) {
  StateStore store(kState, {}, disk);
  EXPECT_GT(store.first_version(), promised.used) << when << ": a version is used twice";
  std::map<std::string, std::uint64_t> found;
  store.load([&](const SceneRecord& r) {
    found[r.id] = r.version;
    const SceneRecord whole = record(r.id, r.version);
    EXPECT_EQ(r.map_modulus_pa, whole.map_modulus_pa) << when;
    EXPECT_EQ(r.map_log_deviation, whole.map_log_deviation) << when;
  });
  for (const auto& [id, version] : promised.least) {
    EXPECT_TRUE(found.contains(id)) << when << ": scene " << id << " is lost";
    EXPECT_GE(found[id], version) << when;
  }
  for (const auto& [id, version] : found) {
    EXPECT_FALSE(promised.gone.contains(id)) << when << ": deleted scene " << id << " is back";
    EXPECT_LE(version, promised.written.at(id)) << when;
  }
}

TEST(PowerFailure, AtAnyOperationNothingAcknowledgedIsLost) {
  const auto count = [] {  // of a life that finds a state
    const auto disk = std::make_shared<LosingDisk>();
    Promised promised;
    live(disk, promised);
    const std::size_t before = disk->count();
    live(disk, promised);
    return disk->count() - before;
  }();
  ASSERT_GT(count, 60U);
  struct Way {
    Unsynced unsynced;
    unsigned seed;
  };
  std::vector<Way> ways{{Unsynced::kLost, 0}, {Unsynced::kKept, 0}};
  for (unsigned seed = 0; seed < 6; ++seed) ways.push_back({Unsynced::kByChance, seed});
  for (std::size_t at = 0; at < count; ++at)
    for (const Way& way : ways) {
      const auto disk = std::make_shared<LosingDisk>();
      Promised promised;
      live(disk, promised);  // there is a state already
      disk->fail_power_at(at);
      EXPECT_THROW(live(disk, promised), PowerFailed) << at;
      disk->restart(way.unsynced, way.seed + static_cast<unsigned>(at));
      const std::string when = "operation " + std::to_string(at) + ", way " +
                               std::to_string(static_cast<int>(way.unsynced)) + "." +
                               std::to_string(way.seed);
      expect_kept(disk, promised, when);
      if (HasFailure()) return;
    }
}

TEST(PowerFailure, InTheVeryFirstLifeTheFoldersThemselvesAreThere) {
  for (std::size_t at = 0;; ++at) {
    const auto disk = std::make_shared<LosingDisk>();
    Promised promised;
    disk->fail_power_at(at);
    bool failed = false;
    try {
      live(disk, promised);
    } catch (const PowerFailed&) {
      failed = true;
    }
    if (!failed) break;
    disk->restart(Unsynced::kLost, 0);
    expect_kept(disk, promised, "operation " + std::to_string(at));
  }
}

void expect_none(StateStore& store) {
  store.load([](const SceneRecord& r) { ADD_FAILURE() << r.id; });
}

TEST(PowerFailure, ASceneThatIsSetAsideIsNotLost) {
  for (const Unsynced way : {Unsynced::kLost, Unsynced::kByChance})
    for (std::size_t at = 0; at < 40; ++at) {
      const auto disk = std::make_shared<LosingDisk>();
      {
        StateStore store(kState, {}, disk);
        store.save(record("a", 1));
      }
      disk->write(kState / "scenes/a/scene.json", std::string("rubbish"));
      disk->sync(kState / "scenes/a/scene.json");
      disk->fail_power_at(at);
      try {
        StateStore store(kState, {}, disk);
        expect_none(store);
      } catch (const PowerFailed&) {
      }
      disk->restart(way, static_cast<unsigned>(at));
      StateStore store(kState, {}, disk);
      expect_none(store);
      EXPECT_EQ(disk->list(kState / "set-aside").size(), 1U) << at;
      EXPECT_TRUE(disk->list(kState / "scenes").empty()) << at;
    }
}

}  // namespace
}  // namespace teletact::service
