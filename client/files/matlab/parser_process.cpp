#include "client/files/matlab/parser_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <new>
#include <span>
#include <utility>

#include "client/files/matlab/mat_parser.h"
#include "client/text/shown.h"

namespace teletact::client {
namespace {

constexpr const char* kName = "teletact-mat-parser";  // argv[0]; then variable, axis, bytes, seconds
constexpr int kArguments = 5;
constexpr std::size_t kMostWords = 1000;  // of an error
constexpr const char* kFile = "/proc/self/fd/0";

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kBoundsAddresses = false;  // their shadow takes terabytes
#elif defined(__has_feature)
constexpr bool kBoundsAddresses = !__has_feature(address_sanitizer) && !__has_feature(thread_sanitizer);
#else
constexpr bool kBoundsAddresses = true;
#endif

// Before the samples, or before the words of an error.
struct Head {
  enum Kind : std::uint64_t { kFrames = 1, kRefused, kNoMemory } kind;
  std::array<std::uint64_t, 3> counts;  // samples, lines, frames; or the words' bytes
};

// --- in the process of its own

void write_all(const void* data, std::size_t bytes) {
  const auto* at = static_cast<const char*>(data);
  while (bytes > 0) {
    const ssize_t written = ::write(STDOUT_FILENO, at, bytes);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) ::_exit(EXIT_FAILURE);  // nobody reads
    at += written, bytes -= static_cast<std::size_t>(written);
  }
}

void limit(decltype(RLIMIT_AS) what, rlim_t value) {
  const rlimit both{value, value};
  if (::setrlimit(what, &both) != 0) ::_exit(EXIT_FAILURE);
}

// Nothing that it inherited but the file and the pipe stays open, and no file can be written.
void confine(rlim_t address_bytes, rlim_t seconds) {
  constexpr rlim_t kDescriptors = 8;
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::close_range(STDERR_FILENO + 1, ~0U, 0) != 0 || ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0)
    ::_exit(EXIT_FAILURE);
  ::setenv("HDF5_PLUGIN_PRELOAD", "::", 1);  // a file cannot name code to be loaded
  if (kBoundsAddresses) limit(RLIMIT_AS, address_bytes);
  limit(RLIMIT_CPU, seconds);
  limit(RLIMIT_FSIZE, 0);
  limit(RLIMIT_CORE, 0);
  limit(RLIMIT_NOFILE, kDescriptors);
}

void say(Head::Kind kind, const std::string& words) {
  write_all(std::array{Head{kind, {words.size(), 0, 0}}}.data(), sizeof(Head));
  write_all(words.data(), words.size());
}

void parse_and_say(const std::string& variable, AxialAxis axial) try {
  const MatFrames frames = parse_mat(kFile, variable, axial);
  const Head head{Head::kFrames, {frames.sample_count, frames.line_count, frames.frame_count}};
  write_all(&head, sizeof head);
  write_all(frames.samples.data(), frames.samples.size() * sizeof(float));
} catch (const FileError& error) {
  const std::string words = error.what(), named = std::string(kFile) + ": ";
  say(Head::kRefused, words.substr(words.starts_with(named) ? named.size() : 0, kMostWords));
} catch (const std::bad_alloc&) {
  say(Head::kNoMemory, "");
}

// Instead of main(): before there is any thread, whichever program this is. Other objects of the program may
// not be made yet: what it calls uses none.
[[gnu::constructor]] void be_the_parser(int count, char** arguments, char**) {
  if (count != kArguments || std::strcmp(arguments[0], kName) != 0) return;
  confine(std::strtoull(arguments[3], nullptr, 10), std::strtoull(arguments[4], nullptr, 10));
  parse_and_say(arguments[1],
                std::strcmp(arguments[2], "rows") == 0 ? AxialAxis::kRows : AxialAxis::kColumns);
  ::_exit(EXIT_SUCCESS);
}

// --- in the process that asks

class Descriptor {
 public:
  explicit Descriptor(int number = -1) : number_(number) {}
  Descriptor(Descriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~Descriptor() {
    if (number_ >= 0) ::close(number_);
  }
  int number() const { return number_; }

 private:
  int number_;
};

// Beyond the standard ones, whose numbers the parser's are.
Descriptor beyond_standard(int number) {
  Descriptor low(number);
  return number < 0 || number > STDERR_FILENO
             ? std::move(low)
             : Descriptor(::fcntl(number, F_DUPFD_CLOEXEC, STDERR_FILENO + 1));
}

class Parser {
 public:
  Parser(const std::filesystem::path& path, const std::string& variable, AxialAxis axial,
         const ParserLimits& limits)
      : path_(path), limits_(limits), file_(beyond_standard(::open(path.c_str(), O_RDONLY | O_CLOEXEC))) {
    std::array<int, 2> pipe{};
    if (file_.number() < 0 || ::pipe2(pipe.data(), O_CLOEXEC) != 0)
      throw FileError(path, std::string("cannot be read: ") + std::strerror(errno));
    answer_ = Descriptor(pipe[0]);
    const Descriptor out = beyond_standard(pipe[1]);
    const std::string bytes = std::to_string(limits.address_bytes),
                      seconds = std::to_string(limits.processor.count());
    const char* const arguments[kArguments + 1] = {
        kName,         variable.c_str(), axial == AxialAxis::kRows ? "rows" : "columns",
        bytes.c_str(), seconds.c_str(),  nullptr};
    posix_spawn_file_actions_t actions;
    ::posix_spawn_file_actions_init(&actions);
    ::posix_spawn_file_actions_adddup2(&actions, file_.number(), STDIN_FILENO);
    ::posix_spawn_file_actions_adddup2(&actions, out.number(), STDOUT_FILENO);
    ::posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    const int failed =
        ::posix_spawn(&process_, "/proc/self/exe", &actions, nullptr, const_cast<char**>(arguments), environ);
    ::posix_spawn_file_actions_destroy(&actions);
    if (failed != 0)
      throw FileError(path,
                      std::string("cannot be read: no process for its parser: ") + std::strerror(failed));
  }
  ~Parser() { end(); }
  Parser(const Parser&) = delete;
  Parser& operator=(const Parser&) = delete;

  // Throws FileError where it ends or is silent before.
  void read(void* into, std::size_t bytes) {
    auto* at = static_cast<char*>(into);
    while (bytes > 0) {
      const std::size_t got = some(at, bytes);
      if (got == 0) fail();
      at += got, bytes -= got;
    }
  }
  [[noreturn]] void refuse(const std::string& words) const { throw FileError(path_, words); }
  [[noreturn]] void refuse_memory() const {
    refuse("takes more than " + std::to_string(limits_.address_bytes >> 20) +
           " MiB to read; save fewer frames in one file");
  }

 private:
  std::size_t some(char* at, std::size_t bytes) {
    pollfd ready{answer_.number(), POLLIN, 0};
    const auto patience = std::chrono::milliseconds(limits_.silence).count();
    int polled = 0;
    while ((polled = ::poll(&ready, 1, static_cast<int>(patience))) < 0 && errno == EINTR) {
    }
    if (polled == 0) refuse_time(limits_.silence);
    ssize_t got = 0;
    while ((got = ::read(answer_.number(), at, bytes)) < 0 && errno == EINTR) {
    }
    return got > 0 ? static_cast<std::size_t>(got) : 0;
  }
  [[noreturn]] void refuse_time(std::chrono::seconds limit) const {
    refuse("was not read within " + std::to_string(limit.count()) +
           " s; it is damaged or too large: export it again, with fewer frames");
  }
  [[noreturn]] void fail() {
    int status = 0;
    while (::waitpid(process_, &status, 0) < 0 && errno == EINTR) {
    }
    process_ = -1;
    if (WIFSIGNALED(status) && (WTERMSIG(status) == SIGXCPU || WTERMSIG(status) == SIGKILL))
      refuse_time(limits_.processor);
    refuse("its parser ended before it was done (" +
           (WIFSIGNALED(status) ? "signal " + std::to_string(WTERMSIG(status))
                                : "status " + std::to_string(WEXITSTATUS(status))) +
           "); the file is damaged: export it again with -v7 or -v7.3");
  }
  void end() {
    if (process_ < 0) return;
    ::kill(process_, SIGKILL);
    while (::waitpid(process_, nullptr, 0) < 0 && errno == EINTR) {
    }
  }
  const std::filesystem::path path_;
  const ParserLimits limits_;
  Descriptor file_, answer_;
  pid_t process_ = -1;
};

}  // namespace

MatFrames parse_mat_apart(const std::filesystem::path& path, const std::string& variable, AxialAxis axial,
                          const ParserLimits& limits) {
  const std::size_t file_bytes = readable_file_size(path);
  Parser parser(path, variable, axial, limits);
  Head head{};
  parser.read(&head, sizeof head);
  if (head.kind == Head::kNoMemory) parser.refuse_memory();
  if (head.kind == Head::kRefused && head.counts[0] <= kMostWords) {
    std::string words(head.counts[0], ' ');
    parser.read(words.data(), words.size());
    parser.refuse(shown(words, kMostWords));
  }
  long double values = 1;
  for (const std::uint64_t count : head.counts) values *= static_cast<long double>(count);
  if (head.kind != Head::kFrames || values < 1 || !can_hold(file_bytes, values, 1))
    parser.refuse("its parser gave an answer that cannot be; the file is damaged: export it again");
  MatFrames frames;
  frames.sample_count = head.counts[0], frames.line_count = head.counts[1],
  frames.frame_count = head.counts[2];
  frames.samples.resize(frames.sample_count * frames.line_count * frames.frame_count);
  parser.read(frames.samples.data(), frames.samples.size() * sizeof(float));
  return frames;
}

}  // namespace teletact::client
