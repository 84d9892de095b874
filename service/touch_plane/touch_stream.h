// One stream of touches on one scene: what is decided of it (touch_exchange.h) is done here, one turn after
// the other, on whatever thread has its turn.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <variant>

#include "service/device/current_device.h"
#include "service/scene/finger.h"
#include "service/touch_plane/law_outbox.h"
#include "service/touch_plane/tactile_outbox.h"
#include "service/touch_plane/touch_exchange.h"
#include "service/touch_plane/touch_session.h"

namespace teletact::service {

// What a stream is opened with.
struct TouchStreamOptions {
  std::string session_id;
  std::uint64_t credit = 0;  // 0: 1
  double period_s = 0;       // 0: TouchStream::kUsualPeriodS
  TouchOptions touch;
  bool laws = false;                      // contact laws, too
  bool pressure = false;                  // nodal pressures, too
  std::optional<TaxelGrid> tactile = {};  // tactile images, too
  bool may_steer = true;
};

class TouchStream {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr double kUsualPeriodS = 0.002;
  static constexpr std::size_t kMaxSessionIdBytes = 64;
  static constexpr std::uint64_t kMaxCredit = 256;  // of a wish; kept is what the limits say
  static constexpr double kLawNearM = 0.010;        // columns of laws this near go before the answer

  using Arrived = TouchExchange::Arrived;
  // What is to be written next: that the stream is open, a piece of a law, or an answer to the pose that was
  // asked for. The last turn is over: none follows.
  struct Opened {
    Clock::duration period;  // that is kept between answers now
  };
  struct Left {};
  struct Answered {
    Arrived asked;
    Clock::duration period;  // as Opened's
    TouchAnswer answer;
    std::uint64_t number = 0;               // counts the answers from 1
    Clock::duration queued{}, computing{};  // the pose, until it was worked on; from then on
    FingerBoard::Steering steering;
    std::optional<SentTactile> tactile = {};  // of this answer or an earlier one
  };
  using Said = std::variant<std::monostate, Opened, LawPiece, Answered, Left>;

  // Throws std::invalid_argument (field named) for options that cannot be met.
  TouchStream(std::shared_ptr<Scene>, TouchStreamOptions, const CurrentDevice&);
  ~TouchStream() { leave(); }
  TouchStream(const TouchStream&) = delete;
  TouchStream& operator=(const TouchStream&) = delete;

  const Scene& scene() const { return *scene_; }
  const Layer& layer() const { return session_.layer(); }
  std::uint64_t credit() const { return exchange_.terms().credit; }
  Clock::duration period() const { return exchange_.terms().period; }  // as agreed
  // Where the tissue is covered, around the finger that steers.
  Region covered() const;
  FingerBoard::Steering steering();

  // By one thread. Throws as TouchExchange::pose(). True: in the place of one that was not answered.
  bool bring(const FingerPose&);
  void hand_over(const std::string& session_id);

  // By one thread at a time. Does what is to be done now, and says what is to be written; nothing where
  // nothing is due. `period`: as TouchExchange::keep().
  Said turn(Clock::duration period = {});
  // After an answer was handed on (TouchSession::look_ahead).
  void look_ahead();

  // By any. What was said has been written: nothing is said before.
  void written();
  // The last turn is due.
  void end();
  // When the next turn is due; Time::max(): not before one of these calls, or not before it was said to be
  // since the last turn.
  Clock::time_point due();
  // Throws Error(kDeadline) when no pose has come for too long.
  void require_poses(Clock::time_point now) const;

  TouchExchange::Counts counts() const;

 private:
  // From now on another stream steers; again: changes nothing.
  void leave();
  Answered answer();
  // What of laws goes before the answer to `asked`, or between two answers.
  std::optional<LawPiece> law_for(TouchExchange::Work);
  bool more_laws(Clock::time_point now) const { return laws_ && laws_->expects_more(now); }
  bool may_enter(const WindowModel&, const Vector3& position_m);
  void tell_observers(const Answered&);
  std::optional<LawPiece> piece_for(const FingerPose&, double farthest_m);

  const std::shared_ptr<Scene> scene_;
  const CurrentDevice& device_;
  mutable std::mutex mutex_;  // of the next two
  TouchExchange exchange_;
  Clock::time_point due_ = Clock::time_point::max();  // as was said since the last turn
  const bool pressure_;
  const std::string session_id_;
  // Of whose turn it is.
  TouchSession session_;
  std::optional<LawOutbox> laws_;         // where they are asked for
  std::optional<TactileOutbox> tactile_;  // the same
  PacedJob surface_;                      // how the layer gives way, for those who look on
  bool surface_told_ = false;
  std::optional<Clock::time_point> awaited_since_;  // the law of a newer version than the one that answers

  const FingerBoard::Stream finger_;  // this stream's at the scene's board
};

// An answer of a touch stream as those get it who look on.
struct ObservedTouch {
  TouchStream::Answered answered;  // without pressure and tactile image
  std::chrono::steady_clock::time_point at;
};

}  // namespace teletact::service
