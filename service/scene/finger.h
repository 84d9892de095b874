// Where the finger is on a scene: touch streams bring it, the patient side watches it (WatchFinger).
//
// One stream steers: its poses alone reach the board, so that the robot arm follows one hand. The first to
// join takes the lease. It lapses when that stream leaves or brings no pose for kLease, and goes to the one
// that has waited longest of those that were heard within kLease; where there is none, to the next that is.
// Who loses the lease waits behind all others. Who may not steer never has it. Takes the time as an argument.
// Thread-safe.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "service/base/force_budget.h"
#include "service/scene/slices.h"

namespace teletact::service {

struct Finger {
  bool present = false;                                // a touch stream steers
  std::array<double, 3> position_m{}, velocity_m_s{};  // of the last pose that steered
  std::int64_t stamp_ns = 0;                           // CLOCK_MONOTONIC when that arrived; 0 = no pose yet
  std::string session_id;                              // of the stream that steers
  std::optional<SliceWish> wish;                       // of the last answer to the one that steers
  std::uint64_t generation = 0;                        // counts changes
};

class FingerBoard {
 public:
  using Clock = std::chrono::steady_clock;
  using Stream = std::uint64_t;  // from 1
  static constexpr std::chrono::seconds kLease{2};

  struct Steering {
    bool steers = false;  // the stream that asked
    std::string by;       // session_id of the one that does
  };

  // `tolerance`: over the force, what a model may put it off by; as usual unless it was asked for.
  Stream join(std::string session_id, Clock::time_point now, double tolerance = Tolerance{}.relative,
              bool may_steer = true);
  void leave(Stream, Clock::time_point now);  // again: changes nothing
  void arrive(Stream, const std::array<double, 3>& position_m, const std::array<double, 3>& velocity_m_s,
              Clock::time_point now);
  // The slice that its last answer lacks, if any.
  void wish(Stream, const std::optional<SliceWish>&);
  // To the stream of that name that has waited longest, which has kLease for its next pose. Changes nothing
  // when `from` does not steer, nobody else who may has that name, or it is empty: a stream without a name
  // cannot be told from others.
  void hand_over(Stream from, const std::string& session_id, Clock::time_point now);

  Steering steering(Stream, Clock::time_point now);
  Finger at(Clock::time_point now);
  // As it was when the board was last used: for who only wants to know about where.
  Finger now() const;
  // The least that anybody who is here asks for; as usual while nobody is.
  double tolerance() const;

 private:
  struct Member {
    Stream stream;
    std::string session_id;
    Clock::time_point heard;  // joined, brought a pose, or was handed the lease
    double tolerance;
    bool may_steer;
  };
  std::vector<Member>::iterator find(Stream);
  void settle(Clock::time_point now);
  void wait_behind(Stream);
  void steer(const Member*);  // null: nobody

  mutable std::mutex mutex_;
  Finger finger_;
  std::vector<Member> members_;  // who waits longest first; the one that steers is among them
  Stream steers_ = 0, last_ = 0;
};

}  // namespace teletact::service
