// A change that hardly shows, and a digest that is hardly wrong.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <thread>

#include "service/access/access.h"
#include "tests/access/access_folder.h"

namespace teletact::service {
namespace {

void changed_at(const std::filesystem::path& file, long nanoseconds) {
  const timespec when{1'700'000'000, nanoseconds};
  const timespec both[2]{when, when};
  ASSERT_EQ(::utimensat(AT_FDCWD, file.c_str(), both, 0), 0);
}

// As long as before, in the same file and in the same second.
TEST(AccessChange, WithinASecondIsTakenOver) {
  const AccessFolder folder;
  const auto file = folder.put("access.toml", entry_of("anna", "operator"));
  changed_at(file, 1'000'000);
  const Access access(file, WallClock::now, std::chrono::milliseconds(50));
  const std::uint64_t first = access.version();
  std::ofstream(file, std::ios::binary) << entry_of("anna", "observer");  // before the first look at it
  changed_at(file, 2'000'000);
  const auto give_up = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  while (access.version() == first && std::chrono::steady_clock::now() < give_up)
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  ASSERT_NE(access.version(), first);
  const auto table = access.table();
  const Principal& anna = table->known({.token = digest_of("anna-token")}, access.now());
  EXPECT_FALSE(AccessTable::may(anna, {Need::kSteer, "s"}));
  EXPECT_TRUE(AccessTable::may(anna, {Need::kFeel, "s"}));
}

// Something else is put in the file's place for a while: `put` does so. Then the file is there again, without
// one of its entries.
class AccessChangeAfter : public testing::TestWithParam<const char*> {
 protected:
  static void put(const std::filesystem::path& file) {
    const std::string what = GetParam();
    std::filesystem::remove(file);
    if (what == "pipe") {
      ASSERT_EQ(::mkfifo(file.c_str(), 0600), 0);
    } else if (what == "folder") {
      std::filesystem::create_directory(file);
    } else if (what == "too_much") {
      std::ofstream(file).close();
      std::filesystem::resize_file(file, std::uintmax_t{3} << 30);
    } else {
      std::filesystem::create_symlink("/dev/" + what, file);
    }
  }
};

TEST_P(AccessChangeAfter, IsTakenOver) {
  const AccessFolder folder;
  const auto file = folder.put("access.toml", entry_of("anna", "operator") + entry_of("ben", "operator"));
  const Access access(file, WallClock::now, std::chrono::milliseconds(5));
  const std::uint64_t first = access.version();
  const auto comes = [](const auto& it) {
    const auto give_up = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (!it() && std::chrono::steady_clock::now() < give_up)
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    return it();
  };
  ASSERT_NO_FATAL_FAILURE(put(file));
  const std::uint64_t before = access.looks();
  EXPECT_TRUE(comes([&] { return access.looks() > before + 1; })) << "waits for it";
  EXPECT_EQ(access.version(), first);
  EXPECT_EQ(access.table()->size(), 2U) << "as it was read before";
  if (std::filesystem::is_directory(file)) std::filesystem::remove(file);
  folder.put("access.toml", entry_of("anna", "operator"));
  ASSERT_TRUE(comes([&] { return access.version() != first; }));
  EXPECT_THROW(access.table()->known({.token = digest_of("ben-token")}, access.now()), AccessRefused);
}

INSTANTIATE_TEST_SUITE_P(Everything, AccessChangeAfter,
                         testing::Values("pipe", "folder", "too_much", "zero", "null", "ptmx"),
                         [](const auto& what) { return std::string(what.param); });

TEST(Token, DigestWithALetterThatIsNoDigitIsNone) {
  EXPECT_TRUE(digest_from(std::string(64, 'a')));
  EXPECT_EQ(digest_from("ag" + std::string(62, 'a')), std::nullopt);
  EXPECT_EQ(digest_from("ga" + std::string(62, 'a')), std::nullopt);
}

}  // namespace
}  // namespace teletact::service
