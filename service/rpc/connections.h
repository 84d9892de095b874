// The TCP connections of the service: accepted here, then handed to gRPC, which counts neither connections
// nor streams that are reset. One that costs more than a peer that keeps to the rules is cut. Thread-safe.
//
// Nobody has shown who it is when a connection comes. Until its first call was let through (vouch()) it is
// one of few, and may send little, and so may all of these together: whatever they do then costs a bounded
// amount, and others find their places.
#pragma once

#include <algorithm>
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

#include "common/file_descriptor.h"
#include "service/rpc/free_memory.h"

namespace teletact::service {

// So many per second, and that of `burst_s` at once after a pause: what a peer may cost that sends as fast as
// it can. Not thread-safe; takes the time as an argument.
class Allowance {
 public:
  using Clock = std::chrono::steady_clock;
  explicit Allowance(double per_second, double burst_s = 0.1)
      : per_second_(per_second), max_(std::max(1.0, per_second * burst_s)), left_(max_) {}
  // Uses one up, or `some`; false when fewer are left by `now`.
  bool take(Clock::time_point now, double some = 1) {
    if (now > last_) {
      const double passed_s = std::chrono::duration<double>(now - last_).count();
      left_ = std::min(max_, left_ + passed_s * per_second_);
      last_ = now;
    }
    if (left_ < some) return false;
    left_ -= some;
    return true;
  }

 private:
  double per_second_, max_, left_;
  Clock::time_point last_{};
};

struct ConnectionLimits {
  // Calls of a connection that are not done: gRPC admits half of it at once. More are calls that were reset
  // and pile up.
  int max_open = 512;
  // Calls of a connection that come to nothing: reset by the peer, refused for who it is, of no such method.
  Allowance wasted{200, 5};
  // Before authority: connections at once, and how long one may at least take to show who it is: the first
  // where few wait, less where more wait than there are places, down to the second.
  std::size_t max_unknown = 256;
  std::chrono::milliseconds min_for_showing{1000}, min_while_many_wait{100};
  // What one may send until then: two of the largest messages, and this much a second. Only one second's
  // where the process has grown by so much since it came: gRPC holds a peer that has not confirmed the
  // settings to no number of calls, and tells nobody of those that wait for a message.
  double unknown_bytes_per_second = 64 << 10;
  std::size_t growth_bytes = 128 << 20;
  // What all of them may send together: calls, from their headers on, and bytes. Beyond it each is cut that
  // has sent more than a first call takes.
  Allowance unknown_calls{1000, 1}, unknown_bytes{1 << 20, 16};
  std::uint64_t first_call_bytes = 4 << 10;
  std::chrono::milliseconds none_after_flood{100};  // come, while others wait
  // What lies between the peer and gRPC until then: once it has read some, a cut reaches the rest.
  int unknown_window_bytes = 16 << 10;
  std::size_t max = 4096;  // connections
  // From a host one of whose connections was cut, others are let in this often for so long.
  Allowance after_cut{2, 1};
  std::chrono::seconds after_cut_for{10};
};

class CountedConnection {
 public:
  using Clock = std::chrono::steady_clock;

  // `socket`: another descriptor of the one that gRPC has.
  CountedConnection(FileDescriptor socket, std::string peer, std::string host, const ConnectionLimits& = {});

  // One call of it.
  void begun();
  void ended() { --open_; }
  void wasted();  // as above
  // Its caller has shown that it may do something here. `kept` lives as long as this does.
  void vouch(std::shared_ptr<const void> kept = nullptr);
  bool vouched() const { return vouched_; }
  // Ends it, with what it has sent and nobody has read. Again: changes nothing.
  void cut(const char* why);
  bool was_cut() const { return cut_; }
  const std::string& peer() const { return peer_; }
  const std::string& host() const { return host_; }
  Clock::time_point since() const { return since_; }
  std::size_t resident_bytes_then() const { return resident_bytes_then_; }  // when it came
  std::uint64_t received_bytes() const;
  struct Seen {
    bool closed;  // gRPC is done with it, or nobody is there any more
    std::uint64_t received_bytes, since_last_look;
  };
  // Of one thread.
  Seen look(Clock::time_point now);
  // When a look last found that what the peer had sent lay where it lay before: this machine is late, not the
  // peer.
  Clock::time_point late_at() const { return late_at_; }

 private:
  const FileDescriptor socket_;
  const std::string peer_, host_;
  const Clock::time_point since_ = Clock::now();
  const std::size_t resident_bytes_then_ = resident_bytes_now();
  const int max_open_;
  std::atomic<int> open_{0};
  std::atomic<bool> vouched_{false}, cut_{false};
  int usual_window_bytes_ = 0;
  std::uint64_t received_bytes_ = 0, read_bytes_ = 0;  // at the last look
  std::atomic<Clock::time_point> late_at_{};
  std::shared_ptr<const void> kept_;
  std::mutex mutex_;  // of the next
  Allowance may_waste_;
};

class Connections {
 public:
  using Clock = std::chrono::steady_clock;
  // Takes the socket over.
  using Hand = std::function<void(int socket, int listener)>;

  // What a call is of before anybody is told of it; gRPC has one for each connection.
  using Identity = const void*;

  explicit Connections(const ConnectionLimits& limits = {})
      : limits_(limits), unknown_calls_(limits.unknown_calls), unknown_bytes_(limits.unknown_bytes) {}
  ~Connections() { end(); }
  Connections(const Connections&) = delete;
  Connections& operator=(const Connections&) = delete;

  // Accepts from now on.
  void begin(std::vector<FileDescriptor> listeners, Hand, std::size_t largest_message_bytes);
  // No more are accepted; those that are there stay.
  void end();

  // Of a call, by what gRPC says of its peer; null: not one of these, a Unix socket's.
  std::shared_ptr<CountedConnection> of(const std::string& peer) const;
  std::size_t count() const;
  // A call's headers have come, whatever becomes of it.
  void call_came(Identity);
  // vouch()es for it, which is of this identity while `kept` lives.
  void vouch(CountedConnection&, Identity, std::shared_ptr<const void> kept);

 private:
  struct AfterCut {
    Clock::time_point until;
    Allowance allowance;
  };
  void serve();
  void look(Clock::time_point now);
  bool make_room(Clock::time_point now);
  void cut_unknown(Clock::time_point now, const char* why);
  Clock::duration patience() const;
  void accept(int listener, Clock::time_point now);
  bool welcome(const std::string& host, Clock::time_point now);

  const ConnectionLimits limits_;
  Hand hand_;
  std::size_t max_unknown_bytes_ = 0;
  std::vector<FileDescriptor> listeners_;
  FileDescriptor woken_;
  std::atomic<bool> stop_{false};
  mutable std::mutex mutex_;
  std::map<std::string, std::shared_ptr<CountedConnection>, std::less<>> by_peer_;
  std::map<Identity, std::string> vouched_;  // the peer
  Allowance unknown_calls_;
  Clock::time_point flooded_{};                // the mutex is of all above
  std::map<std::string, AfterCut> after_cut_;  // of the thread, as the next
  Allowance unknown_bytes_;
  std::size_t unknown_ = 0;
  std::thread thread_;
};

}  // namespace teletact::service
