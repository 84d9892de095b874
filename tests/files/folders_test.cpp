// Folders for results: nobody else's while they are written.
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <optional>

#include "client/files/file_io.h"
#include "client/text/utf8.h"
#include "tests/files/refusal.h"
#include "tests/files/temporary_folder.h"

namespace teletact::client {

// What flock() fails with, as on a file system without locks; 0: it locks.
static int no_locks = 0;

// In place of the C library's.
extern "C" int flock(int file, int operation) noexcept {
  if (no_locks == 0) return static_cast<int>(::syscall(SYS_flock, file, operation));
  errno = no_locks;
  return -1;
}

namespace {

TEST(HeldFolder, IsOneProcessesAtATime) {
  const TemporaryFolder folder;
  std::optional<HeldFolder> first(folder / "out/of/this");
  EXPECT_TRUE(std::filesystem::is_empty(folder / "out/of/this")) << "nothing is left in it";
  EXPECT_NE(refusal_of<FileError>([&] {
              HeldFolder(folder / "out/of/../of/this");
            }).find("another process writes its results there"),
            std::string::npos);
  const HeldFolder other(folder / "out");
  first.reset();
  const HeldFolder again(folder / "out/of/this");
}

TEST(HeldFolder, IsGivenByFileSystemsWithoutLocks) {
  const TemporaryFolder folder;
  for (const int error : {EOPNOTSUPP, ENOLCK, EWOULDBLOCK}) {
    no_locks = error;
    EXPECT_NO_THROW(HeldFolder(folder / "out")) << error;
    EXPECT_TRUE(std::filesystem::is_empty(folder / "out")) << "nothing is left in it";
  }
  no_locks = 0;
}

TEST(HeldFolder, SaysWhyItCannotBeWritten) {
  const TemporaryFolder folder;
  put_content(folder / "file", "");
  const std::string message = refusal_of<FileError>([&] { HeldFolder(folder / "file/out"); });
  EXPECT_NE(message.find("cannot be created (Not a directory)"), std::string::npos) << message;
}

TEST(Utf8, TellsTextFromOtherBytes) {
  for (const char* text :
       {"", "plain", "\xc3\xa4", "\xe2\x82\xac", "\xed\x9f\xbf", "\xf0\x90\x80\x80", "\xf4\x8f\xbf\xbf"})
    EXPECT_TRUE(is_utf8(text)) << text;
  for (const char* bytes :
       {"\xe4", "latin\xe4/a", "\xc3", "\xc3\x28", "\x80", "\xc0\xaf", "\xc1\xbf", "\xe0\x80\xaf",
        "\xed\xa0\x80", "\xf0\x80\x80\xaf", "\xf4\x90\x80\x80", "\xf5\x80\x80\x80", "\xff", "\xe2\x82"})
    EXPECT_FALSE(is_utf8(bytes)) << testing::PrintToString(std::string(bytes));
}

}  // namespace
}  // namespace teletact::client
