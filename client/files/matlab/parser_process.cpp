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
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <new>
#include <span>
#include <utility>

#include "client/files/matlab/mat_parser.h"
#include "client/files/matlab/uff_parser.h"
#include "client/text/shown.h"
#include "common/file_descriptor.h"

namespace teletact::client {
namespace {

constexpr const char* kName = "teletact-mat-parser";  // argv[0]; then how, variable, frame, bytes, seconds
constexpr int kArguments = 6;
constexpr const char *kRows = "rows", *kColumns = "columns", *kUff = "uff";  // how
constexpr std::size_t kMaxWords = 1000;                                      // of an error
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
  enum Kind : std::uint64_t { kFrames = 1, kImage, kRefused, kNoMemory } kind;
  std::array<std::uint64_t, 3> counts;  // samples, lines, frames; or the words' bytes
};

// Between the head of an image and its values.
struct ImageHead {
  double first_sample_depth_m, sample_pitch_m, line_pitch_m;
  double modulation_frequency_hz, sound_speed_m_s;  // NaN: not stated
  std::uint64_t is_complex;                         // 1: the imaginary part follows the real one
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
  // Not every file system has flock(), and nobody else's lock matters to who only reads.
  ::setenv("HDF5_USE_FILE_LOCKING", "FALSE", 1);
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

void write_floats(const std::vector<float>& values) {
  write_all(values.data(), values.size() * sizeof(float));
}

void parse_frames(const std::string& variable, AxialAxis axial) {
  const MatFrames frames = parse_mat(kFile, variable, axial);
  const Head head{Head::kFrames, {frames.sample_count, frames.line_count, frames.frame_count}};
  write_all(&head, sizeof head);
  write_floats(frames.samples);
}

void parse_image(const std::string& object, std::size_t frame) {
  constexpr double kNotStated = std::numeric_limits<double>::quiet_NaN();
  const UffImage image = parse_uff(kFile, object, frame);
  const Head head{Head::kImage, {image.sample_count, image.line_count, image.frame_count}};
  const ImageHead more{image.first_sample_depth_m,
                       image.sample_pitch_m,
                       image.line_pitch_m,
                       image.modulation_frequency_hz.value_or(kNotStated),
                       image.sound_speed_m_s.value_or(kNotStated),
                       image.imaginary.empty() ? 0U : 1U};
  write_all(&head, sizeof head);
  write_all(&more, sizeof more);
  write_floats(image.values);
  write_floats(image.imaginary);
}

void parse_and_say(const std::string& how, const std::string& variable, std::size_t frame) try {
  if (how == kUff)
    parse_image(variable, frame);
  else
    parse_frames(variable, how == kRows ? AxialAxis::kRows : AxialAxis::kColumns);
} catch (const FileError& error) {
  const std::string words = error.what(), named = std::string(kFile) + ": ";
  say(Head::kRefused, words.substr(words.starts_with(named) ? named.size() : 0, kMaxWords));
} catch (const std::bad_alloc&) {
  say(Head::kNoMemory, "");
}

// Instead of main(): before there is any thread, whichever program this is. Other objects of the program may
// not be made yet: what it calls uses none.
[[gnu::constructor]] void be_the_parser(int count, char** arguments, char**) {
  if (count != kArguments || std::strcmp(arguments[0], kName) != 0) return;
  const auto number = [&](int k) { return std::strtoull(arguments[k], nullptr, 10); };
  confine(number(4), number(5));
  parse_and_say(arguments[1], arguments[2], number(3));
  ::_exit(EXIT_SUCCESS);
}

// --- in the process that asks

// Beyond the standard ones, whose numbers the parser's are.
FileDescriptor beyond_standard(int number) {
  FileDescriptor low(number);
  return number < 0 || number > STDERR_FILENO
             ? std::move(low)
             : FileDescriptor(::fcntl(number, F_DUPFD_CLOEXEC, STDERR_FILENO + 1));
}

class Parser {
 public:
  Parser(const std::filesystem::path& path, const char* how, const std::string& variable, std::size_t frame,
         const ParserLimits& limits)
      : path_(path), limits_(limits), file_(beyond_standard(::open(path.c_str(), O_RDONLY | O_CLOEXEC))) {
    std::array<int, 2> pipe{};
    if (file_.get() < 0 || ::pipe2(pipe.data(), O_CLOEXEC) != 0)
      throw FileError(path, std::string("cannot be read: ") + std::strerror(errno));
    answer_ = FileDescriptor(pipe[0]);
    const FileDescriptor out = beyond_standard(pipe[1]);
    const std::string which = std::to_string(frame), bytes = std::to_string(limits.address_bytes),
                      seconds = std::to_string(limits.processor.count());
    const char* const arguments[kArguments + 1] = {
        kName, how, variable.c_str(), which.c_str(), bytes.c_str(), seconds.c_str(), nullptr};
    posix_spawn_file_actions_t actions;
    ::posix_spawn_file_actions_init(&actions);
    ::posix_spawn_file_actions_adddup2(&actions, file_.get(), STDIN_FILENO);
    ::posix_spawn_file_actions_adddup2(&actions, out.get(), STDOUT_FILENO);
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
  std::vector<float> floats(std::size_t count) {
    std::vector<float> out(count);
    read(out.data(), count * sizeof(float));
    return out;
  }
  // The head of what was asked for, of a file of so many bytes. Throws FileError where the parser refused, or
  // said what cannot be.
  Head head(Head::Kind wanted, std::size_t file_bytes) {
    Head head{};
    read(&head, sizeof head);
    if (head.kind == Head::kNoMemory) refuse_memory();
    if (head.kind == Head::kRefused && head.counts[0] <= kMaxWords) {
      std::string words(head.counts[0], ' ');
      read(words.data(), words.size());
      refuse(shown(words, kMaxWords));
    }
    // Of an image's frames it sends one.
    const std::uint64_t frames = wanted == Head::kImage ? 1 : head.counts[2];
    long double values = 1;
    for (const std::uint64_t count : {head.counts[0], head.counts[1], frames})
      values *= static_cast<long double>(count);
    if (head.kind != wanted || values < 1 || head.counts[2] < 1 || !can_hold(file_bytes, values, 1))
      refuse_answer();
    return head;
  }
  [[noreturn]] void refuse_answer() const {
    refuse("its parser gave an impossible answer; the file is damaged: export it again");
  }

 private:
  [[noreturn]] void refuse(const std::string& words) const { throw FileError(path_, words); }
  [[noreturn]] void refuse_memory() const {
    refuse("takes more than " + std::to_string(limits_.address_bytes >> 20) +
           " MiB to read; save fewer frames in one file");
  }
  std::size_t some(char* at, std::size_t bytes) {
    pollfd ready{answer_.get(), POLLIN, 0};
    const auto patience = std::chrono::milliseconds(limits_.silence).count();
    int polled = 0;
    while ((polled = ::poll(&ready, 1, static_cast<int>(patience))) < 0 && errno == EINTR) {
    }
    if (polled == 0) refuse_time(limits_.silence);
    ssize_t got = 0;
    while ((got = ::read(answer_.get(), at, bytes)) < 0 && errno == EINTR) {
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
           "); the file is damaged: export it again");
  }
  void end() {
    if (process_ < 0) return;
    ::kill(process_, SIGKILL);
    while (::waitpid(process_, nullptr, 0) < 0 && errno == EINTR) {
    }
  }
  const std::filesystem::path path_;
  const ParserLimits limits_;
  FileDescriptor file_, answer_;
  pid_t process_ = -1;
};

}  // namespace

MatFrames parse_mat_apart(const std::filesystem::path& path, const std::string& variable, AxialAxis axial,
                          const ParserLimits& limits) {
  const std::size_t file_bytes = readable_file_size(path);
  Parser parser(path, axial == AxialAxis::kRows ? kRows : kColumns, variable, 0, limits);
  const Head head = parser.head(Head::kFrames, file_bytes);
  MatFrames frames;
  frames.sample_count = head.counts[0], frames.line_count = head.counts[1],
  frames.frame_count = head.counts[2];
  frames.samples = parser.floats(frames.sample_count * frames.line_count * frames.frame_count);
  return frames;
}

UffImage parse_uff_apart(const std::filesystem::path& path, const std::string& object, std::size_t frame,
                         const ParserLimits& limits) {
  const std::size_t file_bytes = readable_file_size(path);
  Parser parser(path, kUff, object, frame, limits);
  const Head head = parser.head(Head::kImage, file_bytes);
  ImageHead more{};
  parser.read(&more, sizeof more);
  const auto above = [](double value, double least) { return value > least && std::isfinite(value); };
  const auto stated = [](double value) {
    return std::isnan(value) ? std::nullopt : std::optional<double>(value);
  };
  UffImage image;
  image.sample_count = head.counts[0], image.line_count = head.counts[1], image.frame_count = head.counts[2];
  image.first_sample_depth_m = more.first_sample_depth_m;
  image.sample_pitch_m = more.sample_pitch_m, image.line_pitch_m = more.line_pitch_m;
  image.modulation_frequency_hz = stated(more.modulation_frequency_hz);
  image.sound_speed_m_s = stated(more.sound_speed_m_s);
  if (!above(image.sample_pitch_m, 0) || !above(image.line_pitch_m, 0) ||
      !(image.first_sample_depth_m >= 0 && std::isfinite(image.first_sample_depth_m)) ||
      !(image.modulation_frequency_hz.value_or(0) >= 0) || !above(image.sound_speed_m_s.value_or(1), 0))
    parser.refuse_answer();
  const std::size_t values = image.sample_count * image.line_count;
  image.values = parser.floats(values);
  if (more.is_complex == 1) image.imaginary = parser.floats(values);
  return image;
}

}  // namespace teletact::client
