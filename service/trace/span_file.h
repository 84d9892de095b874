// A file of lines that grows so far and no further: then it becomes FILE.1, in the place of the one before.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace teletact::service {

// By one thread.
class SpanFile {
 public:
  // Adds to what is there; a new file is its owner's alone (0600). Throws std::runtime_error, one line: no
  // file, not to be opened, or another process writes to it.
  SpanFile(std::filesystem::path file, std::uint64_t most_bytes);
  ~SpanFile() { close(); }
  SpanFile(const SpanFile&) = delete;
  SpanFile& operator=(const SpanFile&) = delete;

  // `line`: ends with '\n'. Throws std::runtime_error, one line, when the disk does not take it; then nothing
  // of it is in the file, and the next one may be tried.
  void append(const std::string& line);

 private:
  void open();
  void close();
  void put(const std::string& line);
  [[noreturn]] void fail(const char* what, int number) const;
  const std::filesystem::path file_;
  const std::uint64_t most_bytes_;
  int descriptor_ = -1;
  std::uint64_t bytes_ = 0;
};

}  // namespace teletact::service
