// What every file format here shares: one error type and whole-file writing.
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

// Size in bytes of an existing, readable regular file. Throws FileError otherwise.
std::size_t readable_file_size(const std::filesystem::path& path);

}  // namespace teletact::client
