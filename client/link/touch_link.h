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
//
// A service that is about to stop says so in its answers. Then a successor is opened beside the stream in
// force, by the same address and as the same session, and takes its place with the first answer that can be
// felt; until then all that is felt is the old stream's. The law that is known stays known. A hand that does
// not steer waits a second, and another where it is the first there all the same, so that the one that does
// is there before it.
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
#include "client/link/pose_pace.h"
#include "client/link/recording.h"
#include "client/link/reopening.h"
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
  double yield_s = 1.0;      // that who does not steer moves later
  RecordWriter* recorder = nullptr;
  LatestSlot<NearLaw>* laws = nullptr;  // where the law around the finger goes; null: none is asked for
};

class TouchLink {
 public:
  static constexpr double kHeartbeatS = PosePace::kHeartbeatS;
  static constexpr double kTrialPeriodS = 0.01;  // between poses of a successor that is not in force yet

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
  // One stream, from the search for its service to its end. Guarded by mutex_, but for the thread.
  struct Attempt {
    std::uint32_t call = 0;  // for recordings
    bool opened = false;
    bool ended = false;    // nothing more will be read
    bool over = false;     // its calls have all returned
    bool gave_up = false;  // for its silence
    bool left = false;     // it is not wanted any more
    std::string problem;   // with what the service said, and cannot be worked with
    std::int64_t opened_ns = 0;
    std::int64_t writing_ns = 0;          // since when a write has been under way; 0: none is
    std::uint64_t acknowledged = 0;       // last answer
    std::uint64_t sent_sequence = 0;      // newest pose that was sent on it
    std::uint64_t answered_sequence = 0;  // newest of them that was answered
    std::uint64_t poses_seen = 0;         // of those that the servo gave
    std::int64_t heard_ns = 0;            // last message received
    LawBook law;
    v1::TouchOpened opening;                // of a successor, until it is in force; so are these
    std::vector<v1::RecordEntry> recorded;  // what came and went
    std::optional<grpc::Status> status;     // once it is done
    std::thread thread;
  };

  void run();
  std::unique_ptr<Attempt> begin(bool in_force);
  void leave(std::unique_ptr<Attempt> attempt, std::unique_lock<std::mutex>& lock);
  void open(Attempt& attempt);
  grpc::Status serve(v1::Palpation::Stub& stub, Attempt& attempt);
  void read(Stream& stream, Attempt& attempt);
  bool write_open(Stream& stream, Attempt& attempt);
  void write_poses(Stream& stream, Attempt& attempt);
  bool write(Stream& stream, const v1::TouchRequest& request, std::int64_t now_ns, Attempt& attempt,
             std::unique_lock<std::mutex>& lock);
  void guard(grpc::ClientContext& context, Attempt& attempt);
  bool wait_to_send(std::unique_lock<std::mutex>& lock, const Attempt& attempt, const PosePace& pace);
  bool has_room(const Attempt& attempt) const;
  double interval_s(const Attempt& attempt) const;
  void record(Attempt& attempt, v1::RecordEntry entry);
  void take_opened(Attempt& attempt, const v1::TouchOpened& opened, std::int64_t received_ns);
  void take_answer(Attempt& attempt, const v1::TouchAnswer& answer, std::int64_t received_ns);
  void take_law(Attempt& attempt, const v1::LawPiece& piece);
  bool come_into_force(Attempt& attempt);
  void keep_tactile(const v1::TactileImage& image);
  void tell_law();
  std::optional<double> retry_after_s(const grpc::Status& status, const Attempt& attempt);

  TouchLinkOptions options_;
  LatestSlot<ServoPose>& poses_;
  LatestSlot<ServoAnswer>& answers_;
  Clock& clock_;
  std::uint64_t instance_;

  mutable std::mutex mutex_;  // everything below
  std::condition_variable changed_;
  std::condition_variable turn_;  // of run(): a stream is done, or in force, or its service stops
  Attempt* in_force_ = nullptr;   // the stream that is felt
  bool moving_ = false;           // it says that its service stops
  std::int64_t may_move_ns_ = 0;  // from then on
  bool lets_first_ = false;       // who steers here has yet to be there
  TouchAnswers received_;
  bool guesses_ = false;                 // of it are felt
  std::optional<TactileImage> tactile_;  // that nobody took yet
  Vector3 finger_m_ = Vector3::Zero();   // of the newest pose sent
  std::string failure_;
  std::string last_reason_;  // why the last stream ended: said once, not with every try
  Reopening reopening_;
  std::string hand_over_to_;  // empty: nobody
  bool stopping_ = false;
  ServoPose pose_;                                        // the servo's newest
  std::uint64_t poses_given_ = 0;                         // by the servo
  std::array<std::int64_t, 2 * Pacing::kMax> sent_ns_{};  // of the last poses, by sequence modulo its size
  std::uint64_t sequence_ = 0;  // never starts again, so that the servo can tell old from new
  std::uint32_t call_ = 0;      // streams in force, for recordings
  std::thread thread_;
};

}  // namespace teletact::client
