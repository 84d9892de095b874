// Recordings (proto/teletact/v1/recording.proto): length-delimited RecordEntry messages, header first.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <fstream>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "common/file_descriptor.h"
#include "teletact/v1/recording.pb.h"

namespace teletact::client {

constexpr std::uint32_t kRecordingVersion = 2;  // of the messages: RecordHeader.version

inline void set_message(v1::RecordEntry& entry, const v1::TouchRequest& m) {
  *entry.mutable_touch_request() = m;
}
inline void set_message(v1::RecordEntry& entry, const v1::TouchResponse& m) {
  *entry.mutable_touch_response() = m;
}
inline void set_message(v1::RecordEntry& entry, const v1::EstimateRequest& m) {
  *entry.mutable_estimate_request() = m;
}
inline void set_message(v1::RecordEntry& entry, const v1::EstimateResponse& m) {
  *entry.mutable_estimate_response() = m;
}
inline void set_message(v1::RecordEntry& entry, const v1::WindowTiming& m) {
  *entry.mutable_window() = m;
}
inline void set_message(v1::RecordEntry& entry, const v1::Scene& m) {
  *entry.mutable_scene() = m;
}
inline void set_message(v1::RecordEntry& entry, const v1::GetInfoResponse& m) {
  *entry.mutable_info() = m;
}

// A message as it is recorded: sent or heard at `time_ns` (CLOCK_MONOTONIC), of the call of that number.
template <class Message>
v1::RecordEntry recorded(const Message& message, std::int64_t time_ns, std::uint32_t call) {
  v1::RecordEntry entry;
  entry.set_monotonic_ns(time_ns);
  entry.set_call(call);
  set_message(entry, message);
  return entry;
}

// Writes entries on a thread of its own, so that neither the servo nor the link ever waits for a disk. What
// is written can be read at once (RecordReader::is_written()), and no other writer takes the file meanwhile.
class RecordWriter {
 public:
  static constexpr std::size_t kMaxQueuedBytes = std::size_t{256} << 20;

  // Creates the file, for this user alone, and writes the header. Throws std::runtime_error, naming the file,
  // when it cannot, or another process writes it.
  RecordWriter(const std::string& path, const v1::RecordHeader& header);
  ~RecordWriter();  // as close(), errors swallowed
  RecordWriter(const RecordWriter&) = delete;
  RecordWriter& operator=(const RecordWriter&) = delete;

  // Takes the entry, or drops and counts it when kMaxQueuedBytes wait for the disk. Never blocks on the disk.
  void append(v1::RecordEntry entry);
  // Takes the entry; waits while kMaxQueuedBytes wait for the disk. For senders that may wait.
  void append_waiting(v1::RecordEntry entry);
  // Writes what is queued and closes. Throws std::runtime_error when anything could not be written.
  void close();
  std::uint64_t dropped() const { return dropped_.load(); }

 private:
  void run();
  void push(v1::RecordEntry entry, std::size_t bytes);

  std::string path_;
  FileDescriptor held_;  // locked while this writes
  std::ofstream file_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<v1::RecordEntry> queue_;
  std::size_t queued_bytes_ = 0;
  bool closing_ = false;
  bool failed_ = false;
  std::atomic<std::uint64_t> dropped_{0};
  std::thread thread_;
};

class RecordReader {
 public:
  // Throws std::runtime_error when the file cannot be read, does not start with a header, or is of another
  // version.
  explicit RecordReader(const std::string& path);
  ~RecordReader();
  RecordReader(const RecordReader&) = delete;
  RecordReader& operator=(const RecordReader&) = delete;

  const v1::RecordHeader& header() const { return header_; }
  // The next entry after the header; none at the end, but later, where it is still written. Throws
  // std::runtime_error on a damaged entry. A last entry cut short (the writer was killed) ends the recording
  // and sets truncated().
  std::optional<v1::RecordEntry> next();
  bool truncated() const { return truncated_; }
  // Whether a RecordWriter of this machine has the file.
  bool is_written() const;

 private:
  struct Stream;
  std::string path_;
  FileDescriptor file_;
  std::unique_ptr<Stream> stream_;
  std::int64_t at_ = 0;  // where the next entry begins
  v1::RecordHeader header_;
  bool truncated_ = false;
};

}  // namespace teletact::client
