// What others may put where a file is read.
#include "common/small_file.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>

namespace teletact {
namespace {

namespace fs = std::filesystem;

class SmallFile : public testing::Test {
 protected:
  SmallFile() : folder_(fs::temp_directory_path() / ("teletact-disk-" + std::to_string(::getpid()))) {
    fs::create_directories(folder_);
  }
  ~SmallFile() override { fs::remove_all(folder_); }
  fs::path put(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return folder_ / name;
  }
  fs::path linked_to(const fs::path& target) const {
    fs::remove(folder_ / "link");
    fs::create_symlink(target, folder_ / "link");
    return folder_ / "link";
  }
  fs::path pipe() const {
    EXPECT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
    return folder_ / "pipe";
  }
  const fs::path folder_;
};

using Read = std::string (*)(const fs::path&, std::size_t);

std::string why_not(Read read, const fs::path& path, std::size_t most, int number) {
  try {
    read(path, most);
    return "read";
  } catch (const UnreadFile& error) {
    EXPECT_EQ(error.number, number) << error.what();
    return error.what();
  }
}

TEST_F(SmallFile, IsReadToItsEndAndNoFurtherThanAllowed) {
  for (const Read read : {read_small_file, read_small_stream}) {
    const std::string text(200'000, 'a');
    EXPECT_EQ(read(put("empty", ""), 0), "");
    EXPECT_EQ(read(put("file", text), text.size()), text);
    EXPECT_EQ(read(linked_to(folder_ / "file"), 1 << 20), text);
    EXPECT_EQ(why_not(read, folder_ / "file", text.size() - 1, EFBIG), "it holds more than 199999 bytes");
    fs::resize_file(folder_ / "file", std::uintmax_t{3} << 30);
    EXPECT_EQ(why_not(read, folder_ / "file", 1 << 20, EFBIG), "it holds more than 1048576 bytes");
    EXPECT_EQ(why_not(read, folder_ / "absent", 1 << 20, ENOENT), "No such file or directory");
  }
}

TEST_F(SmallFile, IsNoPipeNoDeviceAndNoFolder) {
  EXPECT_EQ(why_not(read_small_file, pipe(), 1 << 20, EINVAL), "it is a pipe, not a file");
  for (const char* device : {"/dev/zero", "/dev/null"})
    EXPECT_EQ(why_not(read_small_file, linked_to(device), 1 << 20, EINVAL), "it is a device, not a file");
  EXPECT_EQ(why_not(read_small_file, folder_, 1 << 20, EISDIR), "it is a folder, not a file");
}

TEST_F(SmallFile, MayBeAPipeWhereWhoStartsAProgramNamesIt) {
  const fs::path name = pipe();
  std::thread writer([&] { std::ofstream(name) << "said once\n"; });
  EXPECT_EQ(read_small_stream(name, 10), "said once\n");
  writer.join();
  EXPECT_EQ(why_not(read_small_stream, linked_to("/dev/zero"), 1 << 20, EFBIG),
            "it holds more than 1048576 bytes");
  EXPECT_EQ(why_not(read_small_stream, folder_, 1 << 20, EISDIR), "Is a directory");
}

}  // namespace
}  // namespace teletact
