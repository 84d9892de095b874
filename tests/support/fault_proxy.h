// A TCP proxy that does to a connection what long and bad links do, in one thread of the test's own process:
// delay, jitter, loss-like waits, limited bandwidth, stalls, half-open connections, resets, and streams that
// overtake each other. Scripted by a schedule, random choices seeded.
//
// A direction is a wire of limited bandwidth, then a delay line that holds whatever is on it: what a chunk
// takes is its turn on the wire, its sending, and the delay; a delay alone lowers no throughput.
//
// What it keeps of TCP: bytes of one connection and direction stay in order (a late chunk holds up all behind
// it); a writer that fills kMaxQueuedBytes before the wire, or behind a receiver that does not read, waits.
// What it does not repeat: where the stream is cut into chunks depends on timing, so a seed fixes the
// sequence of random choices, not the byte each falls on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <list>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <vector>

struct pollfd;

namespace teletact::test {

// What one direction of every connection suffers all the time.
struct DirectionFaults {
  double delay_s = 0;             // of every chunk
  double jitter_s = 0;            // on top of the delay, uniform in [0, jitter_s] for each chunk
  double loss_share = 0;          // of the chunks: "lost", so that they and all behind them wait ...
  double retransmission_s = 0.2;  // ... for so long
  double bandwidth_bytes_s = 0;   // 0: not limited
};
struct Faults {
  DirectionFaults up = {};    // client to service
  DirectionFaults down = {};  // service to client
  double idle_s = 0;  // a connection that carries nothing for so long is dropped, as proxies do; 0: never
};

// One line of a schedule.
struct FaultEvent {
  enum class Kind {
    kFaults,    // from now on `faults`
    kStall,     // nothing passes on any connection, new ones included, for `seconds`; then all of it does
    kHold,      // the same for the connections open now; newer ones pass, and so overtake them
    kHalfOpen,  // the connections open now never carry or say anything again; newer ones pass
    kReset,     // the connections open now are reset (RST)
  };
  double at_s = 0;  // since play()
  Kind kind = Kind::kFaults;
  double seconds = 0;
  Faults faults = {};
};

class FaultProxy {
 public:
  static constexpr std::size_t kMaxQueuedBytes = 256 << 10;  // per connection and direction, not on its way

  // Passes connections on to `target`, "unix:/path" or "127.0.0.1:port". Throws std::runtime_error.
  explicit FaultProxy(std::string target, std::uint64_t seed = 1);
  ~FaultProxy();
  FaultProxy(const FaultProxy&) = delete;
  FaultProxy& operator=(const FaultProxy&) = delete;

  // "127.0.0.1:port", to connect to.
  const std::string& address() const { return address_; }
  // Takes the place of what is left of the schedule before. Any thread.
  void play(std::vector<FaultEvent> schedule);
  // One event, now.
  void play(FaultEvent event);

  std::uint64_t connections() const;  // accepted so far
  std::uint64_t bytes_up() const;     // delivered to the service
  std::uint64_t bytes_down() const;

 private:
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
  struct Chunk {
    std::vector<char> bytes;
    std::size_t sent = 0;
    std::int64_t wired_ns = 0;  // when its last byte has left the wire for the delay line
    std::int64_t due_ns = 0;    // when it is delivered
  };
  struct Pipe {
    int from = -1, to = -1;
    std::deque<Chunk> chunks;
    std::int64_t last_wired_ns = 0, last_due_ns = 0;
    bool read_ended = false, write_ended = false, blocked = false;
    // Waits for the wire, or was not taken when it was due.
    std::size_t queued_bytes(std::int64_t now_ns) const;
  };
  struct Connection {
    int client = -1, service = -1;
    Pipe up, down;
    std::int64_t held_until_ns = 0;
    std::int64_t carried_ns = 0;  // when a byte came last
    bool failed = false;
  };

  void run();
  std::int64_t play_due_events(std::int64_t now_ns);
  void apply(const FaultEvent& event, std::int64_t now_ns);
  void accept_one();
  void read_some(Pipe& pipe, const DirectionFaults& faults, std::int64_t now_ns, Connection& connection);
  std::int64_t deliver(Pipe& pipe, std::int64_t now_ns, Connection& connection, std::uint64_t& delivered);
  void put_on_wire(const DirectionFaults& faults, Pipe& pipe, Chunk chunk, std::int64_t now_ns);
  void close_connection(Connection& connection, bool reset);
  std::int64_t drop_if_idle(Connection& connection, std::int64_t now_ns) const;
  std::int64_t move_bytes(const std::vector<pollfd>& polled, std::int64_t now_ns);
  std::vector<pollfd> polls(std::int64_t now_ns) const;
  void wake();

  std::string target_, address_;
  int listening_ = -1, wake_ = -1;

  mutable std::mutex mutex_;  // everything below
  std::mt19937_64 random_;
  Faults faults_ = {};
  std::deque<FaultEvent> schedule_;
  std::int64_t schedule_begin_ns_ = 0;
  std::int64_t stalled_until_ns_ = 0;
  std::list<Connection> connections_;
  std::uint64_t accepted_ = 0, bytes_up_ = 0, bytes_down_ = 0;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace teletact::test
