#include "client/link/recording.h"

#include <fcntl.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl.h>
#include <google/protobuf/util/delimited_message_util.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace teletact::client {
namespace {

namespace util = google::protobuf::util;
namespace io = google::protobuf::io;

constexpr std::uint32_t kMaxEntryBytes = std::uint32_t{1} << 30;

// A lock of an open file, not of a process: what else this one opens and closes does not end it.
struct flock whole_file() {
  struct flock whole {};
  whole.l_type = F_WRLCK;
  whole.l_whence = SEEK_SET;
  return whole;
}

// Some file systems know no locks: there nobody is kept away.
FileDescriptor locked(const std::string& path) {
  FileDescriptor file(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, S_IRUSR | S_IWUSR));
  struct flock whole = whole_file();
  if (file && ::fcntl(file.get(), F_OFD_SETLK, &whole) != 0 && (errno == EAGAIN || errno == EACCES))
    throw std::runtime_error("cannot write the recording '" + path +
                             "': another session writes it; choose another file with --record");
  return file;
}

// A file of this user's alone, and another than an earlier session's, which somebody may still read. Only who
// has locked a file replaces it.
FileDescriptor hold(const std::string& path) {
  while (true) {
    FileDescriptor file = locked(path);
    struct stat held {
    }, there{};
    if (!file || ::fstat(file.get(), &held) != 0 || !S_ISREG(held.st_mode)) return file;
    const bool replaced = ::stat(path.c_str(), &there) != 0 || there.st_ino != held.st_ino;
    const bool ours = held.st_uid == ::geteuid() && (held.st_mode & (S_IRWXG | S_IRWXO)) == 0;
    if (!replaced && ours && held.st_size == 0) return file;
    if (!replaced && ::unlink(path.c_str()) != 0)
      throw std::runtime_error("cannot replace the recording '" + path + "': " + std::strerror(errno) +
                               "; choose another file with --record");
  }
}

}  // namespace

RecordWriter::RecordWriter(const std::string& path, const v1::RecordHeader& header)
    : path_(path), held_(hold(path)), file_(path, std::ios::binary | std::ios::trunc) {
  v1::RecordEntry first;
  *first.mutable_header() = header;
  first.mutable_header()->set_version(kRecordingVersion);
  if (!file_ || !util::SerializeDelimitedToOstream(first, &file_) || !file_.flush()) {
    throw std::runtime_error("cannot write the recording '" + path + "': " + std::strerror(errno) +
                             "; choose another file with --record");
  }
  thread_ = std::thread([this] { run(); });
}

RecordWriter::~RecordWriter() {
  try {
    close();
  } catch (const std::exception&) {
  }
}

void RecordWriter::append(v1::RecordEntry entry) {
  const std::size_t bytes = entry.ByteSizeLong();
  std::unique_lock lock(mutex_);
  if (closing_ || failed_ || queued_bytes_ + bytes > kMaxQueuedBytes) {
    ++dropped_;
    return;
  }
  push(std::move(entry), bytes);
}

void RecordWriter::append_waiting(v1::RecordEntry entry) {
  const std::size_t bytes = entry.ByteSizeLong();
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] {
    return closing_ || failed_ || queue_.empty() || queued_bytes_ + bytes <= kMaxQueuedBytes;
  });
  if (closing_ || failed_) {
    ++dropped_;
    return;
  }
  push(std::move(entry), bytes);
}

void RecordWriter::push(v1::RecordEntry entry, std::size_t bytes) {
  queued_bytes_ += bytes;
  queue_.push_back(std::move(entry));
  changed_.notify_all();
}

void RecordWriter::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return closing_ || !queue_.empty(); });
    if (queue_.empty()) return;
    const std::deque<v1::RecordEntry> entries = std::exchange(queue_, {});
    lock.unlock();
    std::size_t bytes = 0;
    for (const v1::RecordEntry& entry : entries) {
      util::SerializeDelimitedToOstream(entry, &file_);
      bytes += entry.ByteSizeLong();
    }
    file_.flush();
    lock.lock();
    queued_bytes_ -= bytes;
    if (!file_) {
      failed_ = true;
      queue_.clear();
      queued_bytes_ = 0;
    }
    changed_.notify_all();
  }
}

void RecordWriter::close() {
  {
    std::lock_guard lock(mutex_);
    closing_ = true;
    changed_.notify_all();
  }
  if (!thread_.joinable()) return;
  thread_.join();
  file_.close();
  held_ = FileDescriptor();
  if (failed_ || !file_) {
    throw std::runtime_error("the recording '" + path_ + "' is incomplete: writing failed (disk full?)");
  }
}

struct RecordReader::Stream {
  explicit Stream(int descriptor) : file(descriptor) {}
  io::FileInputStream file;
};

RecordReader::RecordReader(const std::string& path)
    : path_(path), file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)) {
  if (!file_) throw std::runtime_error("cannot read the recording '" + path + "': " + std::strerror(errno));
  struct stat status {};
  if (::fstat(file_.get(), &status) != 0 || !S_ISREG(status.st_mode))
    throw std::runtime_error("'" + path + "' is not a file: give that of touch or acquire --record");
  stream_ = std::make_unique<Stream>(file_.get());
  std::optional<v1::RecordEntry> first;
  try {
    first = next();
  } catch (const std::runtime_error&) {
  }
  if (!first || !first->has_header()) {
    throw std::runtime_error("'" + path + "' is not a teletact-client recording (touch or acquire --record)");
  }
  header_ = first->header();
  if (header_.version() != kRecordingVersion)
    throw std::runtime_error("the recording '" + path + "' is of version " +
                             std::to_string(header_.version()) + ", and this client reads version " +
                             std::to_string(kRecordingVersion) + ": record it again");
}

RecordReader::~RecordReader() = default;

bool RecordReader::is_written() const {
  struct flock whole = whole_file();
  return ::fcntl(file_.get(), F_OFD_GETLK, &whole) == 0 && whole.l_type != F_UNLCK;
}

std::optional<v1::RecordEntry> RecordReader::next() {
  // A coded stream per entry: its limit counts the bytes of one entry, not those of the file.
  std::optional<io::CodedInputStream> coded(&stream_->file);
  const void* next_bytes = nullptr;
  int ready = 0;
  if (!coded->GetDirectBufferPointer(&next_bytes, &ready)) return std::nullopt;  // the end, after an entry
  std::uint32_t bytes = 0;
  std::string body;
  const bool has_length = coded->ReadVarint32(&bytes);
  constexpr int kLengthBytes = 5;  // at most
  if (has_length ? bytes > kMaxEntryBytes : ready >= kLengthBytes)
    throw std::runtime_error("the recording '" + path_ + "' is damaged");
  struct stat status {};
  const bool there = has_length && ::fstat(file_.get(), &status) == 0 &&
                     at_ + coded->CurrentPosition() + static_cast<off_t>(bytes) <= status.st_size;
  if (!there || !coded->ReadString(&body, static_cast<int>(bytes))) {
    truncated_ = true;
    coded.reset();
    ::lseek(file_.get(), at_, SEEK_SET);  // the rest of it may be written yet
    stream_ = std::make_unique<Stream>(file_.get());
    return std::nullopt;
  }
  truncated_ = false;
  at_ += coded->CurrentPosition();
  v1::RecordEntry entry;
  if (!entry.ParseFromString(body)) throw std::runtime_error("the recording '" + path_ + "' is damaged");
  return entry;
}

}  // namespace teletact::client
