// What every fuzzer is made of. A fuzzer is a function that feeds bytes to one boundary of the product, says
// whether they were taken, and throws Broken where the product breaks what it states, whatever the bytes are:
// it refuses them with an error of a stated type and one plain line, or what comes out keeps its bounds and
// is written and read back the same.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

namespace teletact::fuzzers {

using Bytes = std::span<const std::uint8_t>;

struct Broken : std::logic_error {
  using std::logic_error::logic_error;
};

inline void require(bool holds, const char* what) {
  if (!holds) throw Broken(what);
}

// One line, printable, of at most 2000 bytes: what a person can read in a terminal or a log.
void require_one_line(std::string_view message);

std::string text_of(Bytes bytes);

// The bytes up to a 0, which are cut off together with it; all of them where there is none.
Bytes cut(Bytes& bytes);

// True when `read` came through; false when it threw one of `Error`, whose message is one plain line.
// Anything else that it throws goes on: a find.
template <class Error, class... Others, class Read>
bool accepted(Read&& read) {
  try {
    if constexpr (sizeof...(Others) > 0) return accepted<Others...>(read);
    read();
    return true;
  } catch (const Error& error) {
    require_one_line(error.what());
    return false;
  }
}

// A file in memory, for readers that want a path.
class InputFile {
 public:
  InputFile();
  ~InputFile();
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;
  void fill(Bytes bytes);
  const std::filesystem::path& path() const { return path_; }

 private:
  int descriptor_;
  std::filesystem::path path_;
};

// A folder that ends with the process.
class Folder {
 public:
  Folder();
  ~Folder();
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// From here on each line of the log must be one plain line; it is not printed.
void require_plain_log();

}  // namespace teletact::fuzzers
