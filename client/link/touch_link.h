// The touch stream as the operator side keeps it: the newest pose out, the newest answer in, and the stream
// opened again, with the same session, whenever it ends.
//
// A pose is sent when fewer than `credit` poses are unanswered, at most one per negotiated period, and always
// the newest: nothing queues. Each pose acknowledges the last answer. When answers stay away, a heartbeat
// pose goes out every kHeartbeatS, so that the service works on a fresh pose once it can, and no proxy
// between takes the stream for idle. After `dead_s` of silence (or ten periods, or four round trips, when
// those are longer) the stream counts as dead, since half-open connections say nothing, and a new one is
// made.
//
// Every answer also tells the round trip and the service's clock (servo/clock_offset.h).
#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "client/link/recording.h"
#include "client/servo/clock_offset.h"
#include "client/servo/histogram.h"
#include "client/servo/servo_loop.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::client {

struct TouchLinkOptions {
  std::string address;
  std::string tls_ca;        // PEM text; empty: not encrypted
  v1::TouchOpen open;        // session_id is chosen when empty
  double dead_s = 0.6;       // the force is long zero then: nothing is lost by opening a new stream
  double open_wait_s = 5.0;  // for TouchOpened: the service may have to condense the model first
  RecordWriter* recorder = nullptr;
};

struct TouchLinkStats {
  std::uint64_t poses = 0;     // sent
  std::uint64_t answers = 0;   // received
  std::uint64_t distinct = 0;  // of them, to a pose at another position than the answer before
  std::uint64_t not_covered = 0;
  std::uint64_t failed = 0;        // status FAILED
  std::uint64_t degraded = 0;      // status DEGRADED
  double largest_strain = 0;       // under the finger
  std::uint64_t dropped = 0;       // malformed or foreign answers
  std::uint64_t streams = 0;       // opened, the first included
  std::uint64_t instances = 0;     // service processes seen
  std::uint64_t last_version = 0;  // model version of the last answer
  Histogram latencies_s;           // pose sampled -> answer received, of the distinct ones
  double first_answer_s = 0;       // servo clock
  double last_answer_s = 0;
  double line_y_m = 0;
  double period_s = 0;              // negotiated
  Histogram round_trips_s;          // pose sent -> answer received, less what the service took
  double clock_offset_s = 0;        // the service's clock minus ours, by the newest answer
  double clock_offset_error_s = 0;  // at most
};

class TouchLink {
 public:
  static constexpr double kHeartbeatS = 0.1;

  // Poses come from `poses`, answers go to `answers`; this link is the one reader and the one writer.
  TouchLink(TouchLinkOptions options, LatestSlot<ServoPose>& poses, LatestSlot<ServoAnswer>& answers,
            Clock& clock);
  ~TouchLink();
  TouchLink(const TouchLink&) = delete;
  TouchLink& operator=(const TouchLink&) = delete;

  void start();
  void stop();  // closes the stream; returns when both threads have ended
  TouchLinkStats stats() const;
  // Why no stream is open: empty while one is, or none has ended yet.
  std::string trouble() const;
  bool covered() const;  // the last answer's; true before there is any
  // Why the link gave up (unknown scene, a refused field); empty while it has not.
  std::string failure() const;

 private:
  using Stream = grpc::ClientReaderWriter<v1::TouchRequest, v1::TouchResponse>;
  // What the reader tells the writer of one stream.
  struct Shared {
    bool opened = false;
    bool ended = false;
    std::uint64_t acknowledged = 0;       // last answer
    std::uint64_t answered_sequence = 0;  // newest pose that was answered
    std::int64_t heard_ns = 0;            // last message received
  };

  void run();
  grpc::Status serve(v1::Palpation::Stub& stub);
  void read(Stream& stream);
  void write(Stream& stream, grpc::ClientContext& context);
  bool wait_to_send(std::unique_lock<std::mutex>& lock, std::int64_t next_ns);
  void take_opened(const v1::TouchOpened& opened);
  void take_answer(const v1::TouchAnswer& answer, std::int64_t received_ns);
  void take_stamps(const v1::TouchAnswer& answer, ServoAnswer& converted);
  void log_warning(const v1::TouchAnswer& answer, std::int64_t received_ns);
  void record(v1::RecordEntry entry, std::int64_t now_ns);
  bool should_retry(const grpc::Status& status);
  void pause(double wait_s);

  TouchLinkOptions options_;
  LatestSlot<ServoPose>& poses_;
  LatestSlot<ServoAnswer>& answers_;
  Clock& clock_;
  std::uint64_t instance_;

  mutable std::mutex mutex_;  // everything below
  std::condition_variable changed_;
  Shared shared_;
  TouchLinkStats stats_;
  std::string failure_;
  std::int64_t warned_ns_ = -1'000'000'000;  // when an answer's warning was logged last
  bool remarked_ = false;
  std::string last_reason_;  // why the last stream ended: said once, not ten times a second
  bool covered_ = true;
  bool stopping_ = false;
  bool gave_up_ = false;  // on the current stream, for its silence
  std::uint64_t service_instance_ = 0;
  ClockOffset clock_offset_;
  std::array<std::int64_t, 64> sent_ns_{};  // of the last poses, by sequence modulo its size
  std::uint64_t sequence_ = 0;              // never starts again, so that the servo can tell old from new
  std::uint32_t call_ = 0;                  // stream attempts, for recordings
  std::uint32_t credit_ = 1;
  Vector2 last_position_m_{1e300, 1e300};
  std::thread thread_;
};

}  // namespace teletact::client
