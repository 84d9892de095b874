// What every file format here shares: one error type, whole-file writing, and folders for results.
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

namespace teletact::client {

// One line for the user: the file, what is wrong with it, what to do about it.
struct FileError : std::runtime_error {
  FileError(const std::filesystem::path& path, const std::string& problem)
      : std::runtime_error(path.string() + ": " + problem), path(path) {}
  std::filesystem::path path;
};

// Writes `head` then `body` to `path`, replacing it only when all of it is on disk (temporary, then rename).
// Throws FileError (folder missing or not writable, disk full).
void write_file(const std::filesystem::path& path, std::string_view head,
                std::span<const std::byte> body = {});

// Creates the folder and proves that it can be written. Throws FileError with one line that says what is
// wrong.
void require_writable_folder(const std::filesystem::path& folder);

// A folder for results that no other process writes meanwhile: held until this ends, or the process does, on
// file systems that can.
class HeldFolder {
 public:
  // As require_writable_folder(); throws FileError, too, where another process holds it.
  explicit HeldFolder(const std::filesystem::path& folder);
  ~HeldFolder();
  HeldFolder(const HeldFolder&) = delete;
  HeldFolder& operator=(const HeldFolder&) = delete;

 private:
  int descriptor_;
};

// Size in bytes of an existing, readable regular file. Throws FileError otherwise.
std::size_t readable_file_size(const std::filesystem::path& path);

}  // namespace teletact::client
