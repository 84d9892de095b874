// The touch stream as the operator side keeps it: the newest pose out, the newest answer in, and the stream
// opened again, with the same session, whenever it ends.
//
// A pose is sent when fewer are unanswered than fill the link (pacing.h), at most one per negotiated period,
// and always the newest: nothing queues. Each pose acknowledges the last answer. When answers stay away, a
// heartbeat pose goes out after kHeartbeatS, or a round trip where that is longer, so that the service works
// on a fresh pose once it can, and no proxy between takes the stream for idle. A stream counts as dead, and a
// new one is made, after `dead_s` (or ten periods, or four round trips, when those are longer) in which the
// service said nothing, since half-open connections say nothing, or did not take what was written. A stream
// that was refused for what it asks is tried ever more seldom.
//
// Every answer also tells the round trip and the service's clock (servo/clock_offset.h).
#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/link/credentials.h"
#include "client/link/law_book.h"
#include "client/link/pacing.h"
#include "client/link/recording.h"
#include "client/link/retry.h"
#include "client/link/tactile_image.h"
#include "client/link/touch_answers.h"
#include "client/servo/servo_loop.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::client {

struct TouchLinkOptions {
  std::string address;
  Credentials credentials;
  v1::TouchOpen open;        // session_id is chosen when empty
  double dead_s = 0.6;       // the force is long zero then: nothing is lost by opening a new stream
  double open_wait_s = 5.0;  // for TouchOpened: the service may have to condense the model first
  RecordSink* recorder = nullptr;
  LatestSlot<NearLaw>* laws = nullptr;  // where the law around the finger goes; null: none is asked for
};

class TouchLink {
 public:
  static constexpr double kHeartbeatS = 0.1;
  // Between poses where a law is rendered: answers only check it; and where they bring tactile images.
  static constexpr double kLawPeriodS = 0.05, kTactilePeriodS = 0.02;
  static constexpr double kRetryS = 0.1;      // from a stream's end to the next
  static constexpr double kMostRetryS = 5.0;  // when it is refused again and again

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
  // The newest tactile image, once; none since the last.
  std::optional<TactileImage> take_tactile();
  // Why the link gave up (unknown scene, a refused field); empty while it has not.
  std::string failure() const;
  // Lets the session of this name steer, if this one does.
  void hand_over(std::string session_id);

 private:
  using Stream = grpc::ClientReaderWriter<v1::TouchRequest, v1::TouchResponse>;
  // What the reader tells the writer of one stream.
  struct Shared {
    bool opened = false;
    bool ended = false;   // nothing more will be read
    bool over = false;    // its calls have all returned
    std::string problem;  // with what the service said, and cannot be worked with
    std::int64_t opened_ns = 0;
    std::int64_t writing_ns = 0;          // since when a write has been under way; 0: none is
    std::uint64_t acknowledged = 0;       // last answer
    std::uint64_t answered_sequence = 0;  // newest pose that was answered
    std::int64_t heard_ns = 0;            // last message received
  };

  void run();
  grpc::Status serve(v1::Palpation::Stub& stub);
  void read(Stream& stream);
  bool write_open(Stream& stream);
  void write_poses(Stream& stream);
  bool write(Stream& stream, const v1::TouchRequest& request, std::int64_t now_ns,
             std::unique_lock<std::mutex>& lock);
  void guard(grpc::ClientContext& context);
  bool wait_to_send(std::unique_lock<std::mutex>& lock, std::int64_t next_ns);
  void take_opened(const v1::TouchOpened& opened, std::int64_t received_ns);
  void take_answer(const v1::TouchAnswer& answer, std::int64_t received_ns);
  void take_law(const v1::LawPiece& piece);
  void keep_tactile(const v1::TactileImage& image);
  void tell_law();
  std::optional<double> retry_after_s(const grpc::Status& status);
  void pause(double wait_s);

  TouchLinkOptions options_;
  LatestSlot<ServoPose>& poses_;
  LatestSlot<ServoAnswer>& answers_;
  Clock& clock_;
  std::uint64_t instance_;

  mutable std::mutex mutex_;  // everything below
  std::condition_variable changed_;
  Shared shared_;
  TouchAnswers received_;
  LawBook law_;
  bool guesses_ = false;                 // of it are felt
  std::optional<TactileImage> tactile_;  // that nobody took yet
  Vector3 finger_m_ = Vector3::Zero();   // of the newest pose sent
  std::string failure_;
  std::string last_reason_;  // why the last stream ended: said once, not with every try
  Backoff refused_{kRetryS, kMostRetryS};
  std::string hand_over_to_;  // empty: nobody
  bool stopping_ = false;
  bool gave_up_ = false;                                   // on the current stream, for its silence
  std::array<std::int64_t, 2 * Pacing::kMost> sent_ns_{};  // of the last poses, by sequence modulo its size
  std::uint64_t sequence_ = 0;  // never starts again, so that the servo can tell old from new
  std::uint32_t call_ = 0;      // stream attempts, for recordings
  std::thread thread_;
};

}  // namespace teletact::client
