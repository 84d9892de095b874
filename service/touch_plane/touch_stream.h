// One stream of touches on one scene: poses are brought, the newest is answered. No sooner than the period
// after the last answer, and only while fewer than `credit` answers are unacknowledged: a client that does
// not read is never more than `credit` answers behind, and the service buffers nothing for it.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "service/device/current_device.h"
#include "service/scene/finger.h"
#include "service/touch_plane/law_outbox.h"
#include "service/touch_plane/mailbox.h"
#include "service/touch_plane/tactile_outbox.h"
#include "service/touch_plane/touch_session.h"

namespace teletact::service {

// What a stream is opened with.
struct TouchWishes {
  std::string session_id;
  std::uint64_t credit = 0;  // 0: 1
  double period_s = 0;       // 0: TouchStream::kUsualPeriodS
  TouchOptions touch;
  bool laws = false;                      // contact laws, too
  bool pressure = false;                  // nodal pressures, too
  std::optional<TaxelGrid> tactile = {};  // tactile images, too
  bool may_steer = true;
};

struct FingerPose {
  std::uint64_t sequence = 0;      // counts up
  std::uint64_t acknowledged = 0;  // the newest answer that was received
  Vector3 position_m{}, velocity_m_s{};
  std::size_t components = 3;  // of position_m, that were sent
  std::int64_t stamp_ns = 0;   // of its client's clock
  std::uint64_t stamp_instance = 0;
  std::uint64_t laws_acknowledged = 0;  // the newest piece of a law
};

class TouchStream {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr double kUsualPeriodS = 0.002;
  static constexpr std::size_t kMostSessionIdBytes = 64;
  static constexpr std::uint64_t kMostCredit = 256;  // of a wish; kept is what the limits say
  static constexpr double kLawNearM = 0.010;         // columns of laws this near go before the answer

  struct Arrived {
    FingerPose pose;
    Clock::time_point at;
  };
  struct Answered {
    TouchAnswer answer;
    std::uint64_t number = 0;               // counts the answers from 1
    Clock::duration queued{}, computing{};  // the pose, until it was worked on; from then on
    FingerBoard::Steering steering;
    std::optional<SentTactile> tactile = {};  // of this answer or an earlier one
  };

  // Throws std::invalid_argument (field named) for wishes that cannot be met.
  TouchStream(std::shared_ptr<Scene>, TouchWishes, const CurrentDevice&);
  ~TouchStream() { leave(); }
  TouchStream(const TouchStream&) = delete;
  TouchStream& operator=(const TouchStream&) = delete;

  const Scene& scene() const { return *scene_; }
  const Layer& layer() const { return session_.layer(); }
  std::uint64_t credit() const { return credit_; }
  Clock::duration period() const { return period_; }
  // Where the tissue is covered, around the finger that steers.
  Region covered() const;
  FingerBoard::Steering steering();

  // By one thread. Throws std::invalid_argument for a pose out of order, Error(kDeadline) for one whose
  // client does not acknowledge what it was sent. True: in the place of one that was not answered.
  bool bring(const FingerPose&);
  void hand_over(const std::string& session_id);

  // By another. The pose to be answered next, once its time has come and `may_answer`; none when `stopped`,
  // or after a while. Both read atomics, nothing more.
  std::optional<Arrived> next(const std::function<bool()>& may_answer, const std::function<bool()>& stopped);
  Answered answer(const Arrived&);
  // After an answer was handed on (TouchSession::look_ahead).
  void look_ahead();
  // What goes before the answer to this pose: the next piece of a law near its finger, if there is one. The
  // first answer waits for it a little.
  std::optional<LawPiece> law_before(const Arrived&, const std::function<bool()>& stopped);
  // What goes before the next answer: a piece of a law, from the finger that was answered last outwards, if
  // there is one, and at most two of them.
  std::optional<LawPiece> next_law();
  // Waits until `may_write` or `stopped`.
  void wait(const std::function<bool()>& may_write, const std::function<bool()>& stopped);
  // From now on another stream steers; again: changes nothing.
  void leave();

  // By any. Lets next() look at its conditions again.
  void wake() { inbox_.wake(); }
  // Throws Error(kDeadline) when no pose has come for too long.
  void require_poses(Clock::time_point now) const;

  struct Counts {
    std::uint64_t poses, replaced, answers;
  };
  Counts counts() const { return {poses_, replaced_, answered_}; }

 private:
  bool may_enter(const WindowModel&, const Vector3& position_m);
  std::optional<LawPiece> piece_for(const FingerPose&, double farthest_m);

  const std::shared_ptr<Scene> scene_;
  const CurrentDevice& device_;
  const std::uint64_t credit_;
  const Clock::duration period_;
  const bool pressure_;
  TouchSession session_;                            // of who answers
  std::optional<LawOutbox> laws_;                   // where they are asked for
  std::optional<TactileOutbox> tactile_;            // the same
  unsigned pieces_ = 0;                             // of laws, since the last answer
  std::optional<Clock::time_point> awaited_since_;  // the law of a newer version than the one that answers
  std::optional<FingerPose> finger_at_;             // that was answered last; of who answers
  const FingerBoard::Stream finger_;                // this stream's at the scene's board
  std::atomic<Clock::time_point> heard_{Clock::now()};  // since when the next pose is waited for
  std::atomic<Clock::time_point> owed_{};               // since when an answer waits to be acknowledged
  std::atomic<std::uint64_t> answered_{0}, acknowledged_{0};
  Mailbox<Arrived> inbox_;
  Clock::time_point due_ = Clock::now();                        // of the next answer
  std::uint64_t last_sequence_ = 0, poses_ = 0, replaced_ = 0;  // of who brings
};

}  // namespace teletact::service
