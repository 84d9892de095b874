// What a session records, over a Unix socket to whoever of this user connects
// (proto/teletact/v1/recording.proto, length-delimited, header first): a live page, a logger. Whoever appends
// never waits: entries that a peer has no room for are left out, for that peer alone.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "client/link/recording.h"
#include "client/link/unix_socket.h"

namespace teletact::client {

class Publisher : public RecordSink {
 public:
  static constexpr std::size_t kMaxPeers = 8;
  static constexpr std::size_t kMaxQueuedBytes = std::size_t{4} << 20;  // of a peer
  static constexpr const char* kFlag = "--publish";

  // Listens at `path`. Throws std::runtime_error, one line that names the flag.
  Publisher(const std::string& path, const v1::RecordHeader& header);
  ~Publisher() override;
  Publisher(const Publisher&) = delete;
  Publisher& operator=(const Publisher&) = delete;

  // Contact laws, frames and maps are left out. Any thread.
  void append(v1::RecordEntry entry) override;
  // Entries that some peer was not sent, for want of room.
  std::uint64_t dropped() const { return dropped_.load(); }

 private:
  using Bytes = std::shared_ptr<const std::string>;
  struct Peer {
    FileDescriptor file;
    std::deque<Bytes> queue;
    std::size_t queued_bytes = 0, sent = 0;  // of the first
  };

  void run();
  void say_goodbye();
  void accept();
  void hand_out(const std::vector<Bytes>& fresh);
  void queue_for(Peer& peer, const Bytes& bytes);
  static bool send(Peer& peer);  // false: it is gone
  void wake() const;

  std::string path_;
  FileDescriptor listening_, wake_;
  std::list<Peer> peers_;  // of the thread alone
  std::atomic<std::uint64_t> dropped_{0};

  std::mutex mutex_;  // what follows
  std::vector<Bytes> fresh_;
  std::size_t fresh_bytes_ = 0;
  std::vector<Bytes> first_;  // what a newcomer gets first: the header, and what the stream was opened with
  bool stopping_ = false;
  std::thread thread_;
};

// One entry into several sinks.
class RecordSinks : public RecordSink {
 public:
  void add(RecordSink* sink) {  // null: none
    if (sink != nullptr) sinks_.push_back(sink);
  }
  bool empty() const { return sinks_.empty(); }
  void append(v1::RecordEntry entry) override {
    for (std::size_t n = 0; n < sinks_.size(); ++n)
      sinks_[n]->append(n + 1 < sinks_.size() ? entry : std::move(entry));
  }

 private:
  std::vector<RecordSink*> sinks_;
};

}  // namespace teletact::client
