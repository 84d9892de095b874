// The TCP connections of the service: accepted here, then handed to gRPC, which counts neither connections
// nor streams that are reset. One that costs more than a peer that keeps to the rules is cut. Thread-safe.
//
// Nobody has shown who it is when a connection comes. Until its first call was let through (vouch()) it is
// one of few, and may send little: whatever it does then costs a bounded amount, and others find their
// places.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "service/rpc/allowance.h"
#include "service/rpc/file_descriptor.h"
#include "service/rpc/free_memory.h"

namespace teletact::service {

class CountedConnection {
 public:
  using Clock = std::chrono::steady_clock;
  // Calls that are not done: gRPC admits half of it at once. More are calls that were reset, and that
  // pile up.
  static constexpr int kMostOpen = 512;
  // Calls a second that come to nothing, and at once after a pause: reset by the peer, refused for who it is,
  // of no such method.
  static constexpr double kWastedPerSecond = 200, kWastedBurstS = 5;

  // `socket`: another descriptor of the one that gRPC has.
  CountedConnection(FileDescriptor socket, std::string peer, std::string host);

  // One call of it.
  void begun();
  void ended() { --open_; }
  void wasted();  // as above
  // Its caller has shown that it may do something here.
  void vouch() { vouched_ = true; }
  bool vouched() const { return vouched_; }
  // Ends it, with what it has sent and nobody has read. Again: changes nothing.
  void cut(const char* why);
  bool was_cut() const { return cut_; }
  const std::string& peer() const { return peer_; }
  const std::string& host() const { return host_; }
  Clock::time_point since() const { return since_; }
  std::size_t resident_bytes_then() const { return resident_bytes_then_; }  // when it came
  // gRPC is done with it, or nobody is there any more.
  bool closed() const;
  std::uint64_t received_bytes() const;

 private:
  const FileDescriptor socket_;
  const std::string peer_, host_;
  const Clock::time_point since_ = Clock::now();
  const std::size_t resident_bytes_then_ = resident_bytes_now();
  std::atomic<int> open_{0};
  std::atomic<bool> vouched_{false}, cut_{false};
  std::mutex mutex_;  // of the next
  Allowance may_waste_{kWastedPerSecond, kWastedBurstS};
};

class Connections {
 public:
  using Clock = std::chrono::steady_clock;
  // Before authority: at once, and how long one may at least take to show who it is, whoever else waits.
  static constexpr std::size_t kMostUnknown = 128;
  static constexpr std::chrono::seconds kLeastForShowing{1};
  // What one may send until then: two of the largest messages, and this much a second. No more than one
  // second's where the process has grown by so much since it came: gRPC holds a peer that has not confirmed
  // the settings to no number of calls, and those that wait for a message are told to nobody.
  static constexpr double kUnknownBytesPerSecond = 64 << 10;
  static constexpr std::size_t kGrowthBytes = 128 << 20;
  static constexpr std::size_t kMost = 4096;
  // From where one was cut, others are let in so often for so long.
  static constexpr double kAfterCutPerSecond = 2;
  static constexpr std::chrono::seconds kAfterCut{10};

  // Takes the socket over.
  using Hand = std::function<void(int socket, int listener)>;

  Connections() = default;
  ~Connections() { end(); }
  Connections(const Connections&) = delete;
  Connections& operator=(const Connections&) = delete;

  // Listens at each address that the host stands for; port 0: one that is free. Throws std::runtime_error
  // with the system's words.
  std::uint16_t listen(const std::string& host, std::uint16_t port);
  // Accepts from now on.
  void begin(Hand, std::size_t largest_message_bytes);
  // No more are accepted; those that are there stay.
  void end();

  // Of a call, by what gRPC says of its peer; null: not one of these, a Unix socket's.
  std::shared_ptr<CountedConnection> of(const std::string& peer) const;
  std::size_t count() const;
  // Nobody is cut from now on for what it does: for those who try every end of a call, thousands of times.
  void excuse_all() { excused_ = true; }

 private:
  struct AfterCut {
    Clock::time_point until;
    Allowance allowance{kAfterCutPerSecond, 1};
  };
  void serve();
  void look(Clock::time_point now);
  bool make_room(Clock::time_point now);
  void accept(int listener, Clock::time_point now);
  bool welcome(const std::string& host, Clock::time_point now);

  Hand hand_;
  std::size_t most_unknown_bytes_ = 0;
  std::vector<FileDescriptor> listeners_;
  FileDescriptor woken_;
  std::atomic<bool> stop_{false}, excused_{false};
  mutable std::mutex mutex_;
  std::map<std::string, std::shared_ptr<CountedConnection>, std::less<>> by_peer_;
  std::map<std::string, AfterCut> after_cut_;  // of the thread, as the next
  std::size_t unknown_ = 0;
  std::thread thread_;
};

}  // namespace teletact::service
