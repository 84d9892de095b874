#include "service/trace/span_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <stdexcept>
#include <system_error>
#include <utility>

namespace teletact::service {

SpanFile::SpanFile(std::filesystem::path file, std::uint64_t most_bytes)
    : file_(std::move(file)), most_bytes_(most_bytes) {
  open();
}

void SpanFile::fail(const char* what, int number) const {
  throw std::runtime_error("--spans-file " + file_.string() + ": " + what +
                           (number != 0 ? ": " + std::generic_category().message(number) : ""));
}

void SpanFile::open() {
  constexpr int kOwnersAlone = 0600;
  // Not to wait for the reader of a pipe.
  descriptor_ =
      ::open(file_.c_str(), O_RDWR | O_APPEND | O_CREAT | O_CLOEXEC | O_NONBLOCK | O_NOCTTY, kOwnersAlone);
  if (descriptor_ < 0) fail("it cannot be opened", errno);
  try {
    struct stat found {};
    if (::fstat(descriptor_, &found) != 0) fail("it cannot be looked at", errno);
    if (!S_ISREG(found.st_mode)) fail("it is no file", 0);
    if (::flock(descriptor_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
      fail("another process writes to it; name another file", 0);
    bytes_ = static_cast<std::uint64_t>(found.st_size);
    // A process that was killed may have left half a line.
    char last = '\n';
    if (bytes_ > 0 && ::pread(descriptor_, &last, 1, found.st_size - 1) == 1 && last != '\n') put("\n");
  } catch (...) {
    close();
    throw;
  }
}

void SpanFile::close() {
  if (descriptor_ >= 0) ::close(descriptor_);
  descriptor_ = -1;
}

void SpanFile::append(const std::string& line) {
  if (descriptor_ < 0) open();
  if (bytes_ > 0 && bytes_ + line.size() > most_bytes_) {
    // Somebody may have taken it away.
    if (::rename(file_.c_str(), (file_.string() + ".1").c_str()) != 0 && errno != ENOENT)
      fail("it is full, and cannot be renamed", errno);
    close();
    open();
  }
  put(line);
}

void SpanFile::put(const std::string& line) {
  for (std::size_t done = 0; done < line.size();) {
    const ssize_t wrote = ::write(descriptor_, line.data() + done, line.size() - done);
    if (wrote >= 0) {
      done += static_cast<std::size_t>(wrote);
      continue;
    }
    const int number = errno;
    if (number == EINTR) continue;
    // Where that fails too, open() ends the half line.
    if (::ftruncate(descriptor_, static_cast<off_t>(bytes_)) != 0) errno = 0;
    close();
    fail("it cannot be written", number);
  }
  bytes_ += line.size();
}

}  // namespace teletact::service
