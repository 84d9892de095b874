// Text that others wrote, of a bounded size. In place of the file that is meant there may be a pipe, a device
// or one that never ends: nobody waits for that, and it fills no memory.
#pragma once

#include <cstddef>
#include <filesystem>
#include <stdexcept>
#include <string>

namespace teletact {

// What is wrong with it, without its path: "it is a pipe, not a file".
struct UnreadFile : std::runtime_error {
  UnreadFile(const std::string& why, int number) : std::runtime_error(why), number(number) {}
  int number;  // as errno
};

// All of a regular file, of a link's too. Throws UnreadFile: for what is no regular file, which is not
// opened, or holds more than `most` bytes.
std::string read_small_file(const std::filesystem::path& file, std::size_t most);

// The same of anything, for a file that who starts a program names once: it may be a pipe, and is waited for.
std::string read_small_stream(const std::filesystem::path& file, std::size_t most);

}  // namespace teletact
