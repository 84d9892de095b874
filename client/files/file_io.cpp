#include "client/files/file_io.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <system_error>

namespace teletact::client {

namespace fs = std::filesystem;

void write_file(const fs::path& path, std::string_view head, std::span<const std::byte> body) {
  const fs::path temporary = path.string() + ".partial" + std::to_string(::getpid());
  errno = 0;
  std::ofstream out(temporary, std::ios::binary | std::ios::trunc);
  if (!out)
    throw FileError(path, std::string("cannot be written (") + std::strerror(errno) +
                              "); choose an existing folder that you may write to");
  out.write(head.data(), static_cast<std::streamsize>(head.size()));
  if (!body.empty())
    out.write(reinterpret_cast<const char*>(body.data()), static_cast<std::streamsize>(body.size()));
  out.close();
  std::error_code error;
  if (out) fs::rename(temporary, path, error);
  if (!out || error) {
    const std::string reason = error ? error.message() : std::string(std::strerror(errno));
    std::error_code ignored;
    fs::remove(temporary, ignored);
    throw FileError(path, "could not be written completely (" + reason +
                              "); free some disk space or choose another folder");
  }
}

void require_writable_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error)
    throw FileError(folder, "cannot be created (" + error.message() + "); give another folder with --out");
  const fs::path probe = folder / ".teletact-writable";
  errno = 0;
  const bool written = static_cast<bool>(std::ofstream(probe) << 'x' << std::flush);
  const std::string reason = std::strerror(errno);
  fs::remove(probe, error);
  if (!written) throw FileError(folder, "cannot be written (" + reason + "); give another folder with --out");
}

namespace {

// Whether a file that nobody else knows of can be locked there. A file system without locks may refuse it as
// if another process held it.
bool has_locks(const fs::path& folder) {
  std::string name = (folder / ".teletact-lock-XXXXXX").string();
  const int file = ::mkstemp(name.data());
  if (file < 0) return true;
  ::unlink(name.c_str());
  const bool locked = ::flock(file, LOCK_SH | LOCK_NB) == 0;
  ::close(file);
  return locked;
}

}  // namespace

HeldFolder::HeldFolder(const fs::path& folder) : descriptor_(-1) {
  require_writable_folder(folder);
  descriptor_ = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor_ < 0 || ::flock(descriptor_, LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK) return;
  if (!has_locks(folder)) return;
  ::close(descriptor_);
  throw FileError(folder, "another process writes its results there; give another folder with --out");
}

HeldFolder::~HeldFolder() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

std::size_t readable_file_size(const fs::path& path) {
  std::error_code error;
  const auto status = fs::status(path, error);
  if (!fs::exists(status)) throw FileError(path, "does not exist; check the path");
  if (!fs::is_regular_file(status)) throw FileError(path, "is not a file; give the path of a file");
  const auto size = fs::file_size(path, error);
  if (error) throw FileError(path, "cannot be read (" + error.message() + "); check its permissions");
  if (::access(path.c_str(), R_OK) != 0)
    throw FileError(path,
                    std::string("cannot be read (") + std::strerror(errno) + "); check its permissions");
  return static_cast<std::size_t>(size);
}

}  // namespace teletact::client
