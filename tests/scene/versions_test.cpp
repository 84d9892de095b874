// Versions are reserved on disk ahead of their use, and never by who uses them.
#include "service/scene/state_store.h"

#include <gtest/gtest.h>

#include "service/scene/errors.h"
#include "tests/scene/losing_disk.h"

namespace teletact::service {
namespace {

constexpr std::uint64_t kBlock = StateStore::kVersionBlock;

class Versions : public testing::Test {
 protected:
  // Where the next life of the service would begin.
  std::uint64_t next_life() {
    disk->restart(LosingDisk::Unsynced::kLost, 0);
    return StateStore("/state", {}, disk).first_version();
  }
  const std::shared_ptr<LosingDisk> disk = std::make_shared<LosingDisk>();
};

TEST_F(Versions, AreReservedAheadWhenHalfABlockIsLeft) {
  StateStore store("/state", {}, disk);
  VersionCounter versions(&store);
  const std::uint64_t first = versions.next(), end = store.reserved_versions();
  const std::size_t before = disk->count();
  versions.reserve_ahead();
  EXPECT_EQ(disk->count(), before) << "most of the block is left";
  versions.used(first + kBlock * 3 / 4);
  EXPECT_EQ(disk->count(), before);
  versions.reserve_ahead();
  EXPECT_GT(disk->count(), before);
  versions.used(end + 1);  // within the next block: on disk already
  const std::size_t reserved = disk->count();
  EXPECT_EQ(versions.next(), end + 2);
  EXPECT_EQ(disk->count(), reserved);
  EXPECT_GT(next_life(), end + 2);
}

// A disk that is full by the time that whoever stands by has the folder. Nobody else serves its scenes then.
class FillsUp : public LosingDisk {
 public:
  bool fills_up = false;
  std::shared_ptr<void> lock(const Path& path, bool wait) override {
    if (fills_up) fail_from(0, ENOSPC);
    return LosingDisk::lock(path, wait);
  }
};

TEST(VersionsOfAFullDisk, WaitForRoomAfterATakeover) {
  const auto disk = std::make_shared<FillsUp>();
  StateStore first("/state", {}, disk);
  const std::uint64_t used = VersionCounter(&first).next();
  disk->fills_up = true;
  EXPECT_THROW(StateStore("/state", {}, disk), std::runtime_error);
  disk->work_again();
  StateStore store("/state", {}, disk, true);
  VersionCounter versions(&store);
  versions.used(used);
  EXPECT_THROW(versions.next(), Error);
  disk->work_again();
  versions.reserve_ahead();
  EXPECT_GT(versions.next(), used);
}

TEST_F(Versions, WithoutReservationEndWithTheBlock) {
  StateStore store("/state", {}, disk);
  VersionCounter versions(&store);
  disk->fail_from(0, ENOSPC);
  versions.used(store.reserved_versions() - 2);
  EXPECT_THROW(versions.reserve_ahead(), FileError);
  const std::uint64_t last = versions.next();
  EXPECT_EQ(last, store.reserved_versions() - 1);
  try {
    versions.next();
    ADD_FAILURE() << "handed out what another life may";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind, ErrorKind::kExhausted);
  }
  disk->work_again();
  versions.reserve_ahead();
  EXPECT_EQ(versions.next(), last + 1);
  EXPECT_GT(next_life(), last + 1);
}

TEST_F(Versions, ThatAFileTellsFarBeyondTheBlockAreReservedToo) {
  StateStore store("/state", {}, disk);
  VersionCounter versions(&store);
  const std::uint64_t far = 5 * kBlock;
  versions.used(far);
  EXPECT_EQ(versions.next(), far + 1);
  EXPECT_GT(next_life(), far + 1);
}

}  // namespace
}  // namespace teletact::service
