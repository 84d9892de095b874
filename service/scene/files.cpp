#include "service/scene/files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "common/file_descriptor.h"

namespace teletact::service {

namespace fs = std::filesystem;

FileError::FileError(const char* what, const fs::path& path, int number_)
    : std::runtime_error(fmt::format("cannot {} {}: {}", what, path.string(),
                                     number_ == ELOOP   ? "it is a symbolic link, which is not followed"
                                     : number_ == ENXIO ? "it is a pipe or a device, not a file"
                                                        : std::strerror(number_))),
      number(number_) {}

FileError::FileError(const char* what, const fs::path& path, const UnreadFile& error)
    : std::runtime_error(fmt::format("cannot {} {}: {}", what, path.string(), error.what())),
      number(error.number) {}

bool FileError::full() const {
  return number == ENOSPC || number == EDQUOT;
}

namespace {

constexpr mode_t kFileMode = 0600, kFolderMode = 0700;

FileDescriptor opened(const char* what, const fs::path& path, int flags) {
  FileDescriptor file(::open(path.c_str(), flags | O_CLOEXEC | O_NONBLOCK, kFileMode));
  if (!file) throw FileError(what, path, errno);
  return file;
}

// To be written.
FileDescriptor opened_file(const fs::path& path, int flags) {
  FileDescriptor file = opened("write", path, flags | O_CREAT | O_NOFOLLOW);
  struct stat found {};
  if (::fstat(file.get(), &found) != 0) throw FileError("write", path, errno);
  if (!S_ISREG(found.st_mode)) throw FileError("write", path, ENXIO);  // as open() says of a pipe
  return file;
}

class MachineFiles final : public Files {
 public:
  bool exists(const Path& path) override {
    std::error_code error;
    const bool found = fs::exists(path, error);
    if (error) throw FileError("look for", path, error.value());
    return found;
  }
  std::vector<std::string> list(const Path& folder) override {
    std::vector<std::string> names;
    std::error_code error;
    for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error))
      names.push_back(at->path().filename().string());
    if (error) throw FileError("list", folder, error.value());
    std::sort(names.begin(), names.end());
    return names;
  }
  std::uint64_t size(const Path& file) override {
    std::error_code error;
    const std::uint64_t bytes = fs::file_size(file, error);
    if (error) throw FileError("read", file, error.value());
    return bytes;
  }
  std::string read(const Path& file, std::uint64_t most) override {
    try {
      return read_small_file(file, most);
    } catch (const UnreadFile& error) {
      throw FileError("read", file, error);
    }
  }
  void make_folder(const Path& folder) override {
    if (::mkdir(folder.c_str(), kFolderMode) == 0) return;
    const int number = errno;
    const fs::file_status there = fs::symlink_status(folder);
    if (number == EEXIST && fs::is_symlink(there)) throw FileError("make", folder, ELOOP);
    if (number != EEXIST || !fs::is_directory(there)) throw FileError("make", folder, number);
  }
  void write(const Path& path, std::span<const char> bytes) override {
    const FileDescriptor file = opened_file(path, O_WRONLY | O_TRUNC);
    while (!bytes.empty()) {
      const ssize_t wrote = ::write(file.get(), bytes.data(), bytes.size());
      if (wrote < 0 && errno == EINTR) continue;
      if (wrote <= 0) throw FileError("write", path, wrote < 0 ? errno : ENOSPC);
      bytes = bytes.subspan(static_cast<std::size_t>(wrote));
    }
  }
  void sync(const Path& path) override {
    if (::fsync(opened("sync", path, O_RDONLY).get()) != 0) throw FileError("sync", path, errno);
  }
  void rename(const Path& from, const Path& to) override {
    if (::rename(from.c_str(), to.c_str()) != 0) throw FileError("rename", from, errno);
  }
  void remove(const Path& path) override {
    std::error_code error;
    fs::remove_all(path, error);
    if (error) throw FileError("remove", path, error.value());
  }
  std::shared_ptr<void> lock(const Path& path, bool wait) override {
    const auto file = std::make_shared<FileDescriptor>(opened_file(path, O_RDWR));
    while (::flock(file->get(), LOCK_EX | (wait ? 0 : LOCK_NB)) != 0) {
      if (errno == EWOULDBLOCK) return nullptr;
      if (errno != EINTR) throw FileError("lock", path, errno);
    }
    return file;
  }
  void keep_private(const Path& path) override {
    struct stat found {};
    if (::lstat(path.c_str(), &found) != 0) {
      if (errno == ENOENT) return;
      throw FileError("look at", path, errno);
    }
    const bool folder = S_ISDIR(found.st_mode);
    const mode_t mode = folder ? kFolderMode : kFileMode;
    if (!folder && !S_ISREG(found.st_mode)) return;  // a link is not followed
    if ((found.st_mode & 07777) != mode && ::chmod(path.c_str(), mode) != 0)
      throw FileError("change the mode of", path, errno);
    if (!folder) return;
    for (const std::string& name : list(path)) keep_private(path / name);
  }
};

}  // namespace

std::shared_ptr<Files> machine_files() {
  return std::make_shared<MachineFiles>();
}

}  // namespace teletact::service
