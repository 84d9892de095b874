// The life of one touch stream as decisions: what is done for it next, and when. What its client sends and
// what has been done come in as events. The newest pose is answered, no sooner than the period after the last
// answer, and only while fewer than `credit` answers are unacknowledged: a client that does not read is never
// more than `credit` answers behind. Pieces of contact laws go before an answer and between two of them.
//
// One thing is done at a time, and nothing while a write is under way. No threads, no locks, no clock: time
// is an argument.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <utility>

#include "service/contact/touch_model.h"

namespace teletact::service {

// A mailbox of one slot: the newest value wins, a value that was not taken in time is gone. Not thread-safe.
template <class T>
class Mailbox {
 public:
  // Puts `value` in the slot, over an older one. Returns whether an older one was lost.
  bool put(T value) {
    const bool lost = slot_.has_value();
    slot_ = std::move(value);
    return lost;
  }
  std::optional<T> take() { return std::exchange(slot_, std::nullopt); }
  const std::optional<T>& newest() const { return slot_; }

 private:
  std::optional<T> slot_;
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

class TouchExchange {
 public:
  using Clock = std::chrono::steady_clock;
  using Time = Clock::time_point;
  static constexpr unsigned kMaxPieces = 2;  // of laws, between two answers: they wait for no more
  static constexpr std::chrono::milliseconds kLookForLaw{1};  // again, where the first answer waits for one

  struct Terms {
    std::uint64_t credit = 1;
    Clock::duration period{};  // between answers, at least
    bool laws = false;         // pieces of contact laws are sent, too
    double acknowledge_s = 10, idle_s = 60;
  };
  struct Arrived {
    FingerPose pose;
    Time at;
  };
  // kLawBefore: a piece of a law near the finger of `asked`, which is answered once there is none more. kLaw:
  // a piece of one from the finger that was answered last outwards. kLeave: the last, and again to who asks
  // again.
  enum class Work { kNothing, kOpen, kLawBefore, kAnswer, kLaw, kLeave };
  struct Next {
    Work work;
    Time due;  // Time::max() of kNothing: not before another event
  };

  TouchExchange(const Terms& terms, Time now);

  // What comes from outside. Throws std::invalid_argument for a pose out of order, Error(kDeadline) for one
  // whose client does not acknowledge what it was sent. True: in the place of one that was not answered.
  bool pose(const FingerPose&, Time now);
  void written() { writing_ = false; }
  void end() { ended_ = true; }
  // Throws Error(kDeadline) when no pose has come for too long.
  void require_poses(Time now) const;
  // The period from now on: as agreed, or longer where the service has more to do than it can.
  void keep(Clock::duration period);

  Next next(Time now) const;
  // What is to be done now: it is begun, and nothing else is until one of the next lines.
  Work begin(Time now);
  void opened() { did_write(); }
  // A piece was sent, or there was none; `more`: there may soon be.
  void law_sent(Time now, bool sent, bool more);
  // Returns the answer's number, which counts from 1. `more` as of laws.
  std::uint64_t answered(Time now, bool more);
  void failed() { busy_ = false; }

  const Arrived& asked() const { return *asked_; }  // what kAnswer and kLawBefore are of
  const std::optional<FingerPose>& finger() const { return finger_at_; }  // what was answered last
  Clock::duration period() const { return period_; }
  const Terms& terms() const { return terms_; }

  struct Counts {
    std::uint64_t poses, replaced, answers;
  };
  Counts counts() const { return {poses_, replaced_, answered_}; }

 private:
  void did_write() { busy_ = false, writing_ = true; }

  const Terms terms_;
  Clock::duration period_;
  Mailbox<Arrived> inbox_;
  std::optional<Arrived> asked_;         // being answered
  std::optional<FingerPose> finger_at_;  // that was answered last
  bool opened_ = false, busy_ = false, writing_ = false, ended_ = false, left_ = false;
  bool law_looked_for_ = false;  // of asked_: no more of it goes before the answer
  unsigned pieces_ = 0;          // of laws, since the last answer
  Time law_due_;                 // the next look for one
  Time due_;                     // of the next answer
  Time room_;                    // when a pose was last given room by an acknowledgement
  Time heard_;                   // since when the next pose is waited for
  Time owed_{};                  // since when an answer waits to be acknowledged
  std::uint64_t answered_ = 0, acknowledged_ = 0, last_sequence_ = 0, poses_ = 0, replaced_ = 0;
};

}  // namespace teletact::service
