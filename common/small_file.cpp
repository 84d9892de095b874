#include "common/small_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <system_error>

#include "common/file_descriptor.h"

namespace teletact {
namespace {

[[noreturn]] void fail(int number) {
  throw UnreadFile(std::generic_category().message(number), number);
}

FileDescriptor opened(const std::filesystem::path& path, int flags) {
  FileDescriptor file(::open(path.c_str(), flags | O_RDONLY | O_CLOEXEC | O_NOCTTY));
  if (!file) fail(errno);
  return file;
}

void require_regular(const struct stat& found) {
  if (S_ISREG(found.st_mode)) return;
  if (S_ISDIR(found.st_mode)) throw UnreadFile("it is a folder, not a file", EISDIR);
  throw UnreadFile(std::string("it is a ") +
                       (S_ISFIFO(found.st_mode)   ? "pipe"
                        : S_ISSOCK(found.st_mode) ? "socket"
                                                  : "device") +
                       ", not a file",
                   EINVAL);
}

std::string text_of(const FileDescriptor& file, std::size_t most) {
  constexpr std::size_t kAtOnce = std::size_t{64} << 10;
  std::string text;
  while (true) {
    const std::size_t before = text.size();
    text.resize(std::min(most + 1, before + kAtOnce));  // one more tells whether there is more
    const ssize_t got = ::read(file.get(), text.data() + before, text.size() - before);
    const int number = errno;
    text.resize(before + static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
    if (text.size() > most) throw UnreadFile("it holds more than " + std::to_string(most) + " bytes", EFBIG);
    if (got == 0) return text;
    if (got < 0 && number != EINTR) fail(number);
  }
}

}  // namespace

std::string read_small_file(const std::filesystem::path& path, std::size_t most) {
  struct stat found {};
  if (::stat(path.c_str(), &found) != 0) fail(errno);
  require_regular(found);  // first: opening alone does something to some devices
  const FileDescriptor file = opened(path, O_NONBLOCK);
  if (::fstat(file.get(), &found) != 0) fail(errno);
  require_regular(found);  // it may be another one by now
  return text_of(file, most);
}

std::string read_small_stream(const std::filesystem::path& path, std::size_t most) {
  return text_of(opened(path, 0), most);
}

}  // namespace teletact
