// What the state on disk is made with, each operation by itself: so that a test can put a disk in its place
// that is full, fails, or loses what was not synced.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "common/small_file.h"

namespace teletact::service {

// An operation that failed: one line with what and where, and errno's number.
struct FileError : std::runtime_error {
  FileError(const char* what, const std::filesystem::path&, int number);
  FileError(const char* what, const std::filesystem::path&, const UnreadFile&);
  bool full() const;  // no room, or none for this user
  int number;
};

// What is made is its owner's alone: files 0600, folders 0700. No link is followed where something is made:
// in a folder that others may write, it would lead elsewhere. All throw FileError. Nothing is on disk for
// good before sync() of the file, and of the folder that names it.
class Files {
 public:
  using Path = std::filesystem::path;
  virtual ~Files() = default;
  virtual bool exists(const Path&) = 0;
  virtual std::vector<std::string> list(const Path& folder) = 0;  // names, in order
  virtual std::uint64_t size(const Path& file) = 0;               // bytes
  virtual std::string read(const Path& file,
                           std::uint64_t most) = 0;  // of bytes; more fail, and what is no file
  virtual void make_folder(const Path&) = 0;         // one that is there already stays
  virtual void write(const Path& file, std::span<const char> bytes) = 0;  // over what was there
  virtual void sync(const Path& file_or_folder) = 0;                      // a file's bytes, a folder's names
  virtual void rename(const Path& from, const Path& to) = 0;
  virtual void remove(const Path& file_or_folder) = 0;  // with all that is in it; nothing there is no error
  // Held while the result lives. Where another process holds it: null, or with `wait` once that lets it go.
  virtual std::shared_ptr<void> lock(const Path& file, bool wait = false) = 0;
  // Makes what is there its owner's alone, with all that is in it; nothing there is no error.
  virtual void keep_private(const Path& file_or_folder) = 0;
};

// Those of this machine.
std::shared_ptr<Files> machine_files();

}  // namespace teletact::service
