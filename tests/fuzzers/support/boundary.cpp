#include "tests/fuzzers/support/boundary.h"

#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <mutex>

namespace teletact::fuzzers {
namespace {

// spdlog swallows what a sink throws: what is broken ends the process.
class PlainLines : public spdlog::sinks::base_sink<std::mutex> {
 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    try {
      require_one_line({message.payload.data(), message.payload.size()});
    } catch (const Broken& broken) {
      std::fprintf(stderr, "a line of the log: %s\n", broken.what());
      std::abort();
    }
  }
  void flush_() override {}
};

}  // namespace

void require_one_line(std::string_view message) {
  constexpr std::size_t kMaxBytes = 2000;
  constexpr unsigned char kDelete = 0x7f;
  require(!message.empty(), "it says nothing");
  require(message.size() <= kMaxBytes, "it is longer than anybody reads");
  for (const char c : message)
    if (static_cast<unsigned char>(c) < ' ' || static_cast<unsigned char>(c) == kDelete)
      throw Broken("it is not one printable line: " + std::string(message));
}

std::string text_of(Bytes bytes) {
  return {bytes.begin(), bytes.end()};
}

Bytes cut(Bytes& bytes) {
  const auto zero = std::find(bytes.begin(), bytes.end(), 0);
  const Bytes head(bytes.begin(), zero);
  bytes = zero == bytes.end() ? Bytes() : Bytes(zero + 1, bytes.end());
  return head;
}

InputFile::InputFile() : descriptor_(::memfd_create("fuzzed", MFD_CLOEXEC)) {
  if (descriptor_ < 0) throw std::runtime_error("no file in memory could be made");
  path_ = "/proc/self/fd/" + std::to_string(descriptor_);
}

InputFile::~InputFile() {
  ::close(descriptor_);
}

void InputFile::fill(Bytes bytes) {
  if (::ftruncate(descriptor_, 0) != 0 ||
      ::pwrite(descriptor_, bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
    throw std::runtime_error("the file in memory cannot be written");
}

Folder::Folder() {
  std::string name = (std::filesystem::temp_directory_path() / "teletact-fuzz-XXXXXX").string();
  if (!::mkdtemp(name.data())) throw std::runtime_error(name + " could not be made");
  path_ = name;
}

Folder::~Folder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

void require_plain_log() {
  spdlog::set_default_logger(std::make_shared<spdlog::logger>("fuzzed", std::make_shared<PlainLines>()));
}

}  // namespace teletact::fuzzers
