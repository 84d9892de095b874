// Who is being served: limits on calls, and the one thread that looks after them, so that a call ends when
// its time is up, its scene is gone or the service drains. Thread-safe.
#pragma once

#include <grpcpp/support/status.h>

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "service/base/limits.h"

namespace teletact::service {

// kInfo: what is answered while the service starts or drains, too.
enum class CallKind { kTouch, kWatch, kObserve, kEstimate, kUnary, kFullScene, kInfo };
inline constexpr std::size_t kCallKinds = 7;
inline constexpr std::array<const char*, kCallKinds> kKindNames{"touch", "watch",      "observe", "estimate",
                                                                "unary", "full_scene", "info"};

// Why a call was given no place, or lost it.
enum class Refusal { kStarting, kDraining, kFull, kClientShare, kAuthority, kLoad };
inline constexpr std::size_t kRefusals = 6;

// A call as the thread sees it that looks after all of them.
class Served {
 public:
  virtual ~Served() = default;
  // Called every Calls::kTick with no lock held, also after the call is done. Must not block.
  virtual void look(std::chrono::steady_clock::time_point now) = 0;
};

class Calls {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kTick{10};

  // One call, looked after while the ticket lives.
  class Ticket {
   public:
    ~Ticket();
    Ticket(const Ticket&) = delete;
    Ticket& operator=(const Ticket&) = delete;
    std::uint64_t id() const { return id_; }
    // Before the peer is told of the end, so that its next call finds the place free. The call is still
    // looked after.
    void give_place_back();

   private:
    friend class Calls;
    Ticket(Calls* calls, std::uint64_t id) : calls_(calls), id_(id) {}
    Calls* calls_;
    std::uint64_t id_;
  };

  explicit Calls(const Limits&);
  ~Calls();

  void open();
  // Throw Error(kUnavailable) before open(), and from drain() on; from close() on; from leave() on.
  void require_open() const;
  void require_staying() const;
  void require_ready() const;
  // Throws Error(kDeadline) when `field`, a call's first message, was not sent in time.
  void require_first_message(const char* field, Clock::time_point begun, Clock::time_point now) const;
  // Throws Error(kUnavailable | kExhausted), the latter with how many are served and when to come again.
  // Places are counted for each kind. A `client` that is named is given another place only while more are
  // free than it holds: none of them takes what others need.
  std::unique_ptr<Ticket> enter(CallKind, std::weak_ptr<Served>, const std::string& client = "");
  // The end, step by step; none leads back. leave(): all is served, but the service is not ready. close():
  // calls that come are refused, and imaging ends. move(): touches are told to go to another
  // service. drain(): all end. Calls find out when they are looked at next.
  void leave() { advance(State::kLeaving); }
  void close() { advance(State::kClosed); }
  void move() { advance(State::kMoving); }
  void drain() { advance(State::kDraining); }
  bool moving() const { return state_.load() == State::kMoving; }
  std::size_t count() const;
  std::size_t count(CallKind) const;
  // One whose caller may not make it.
  void refused_authority(CallKind);
  // One that has a place, but nobody has time for: throws Error(kExhausted) with the load and when to come
  // again. Its place is free, and says nothing of how long places are held.
  [[noreturn]] void refuse_for_load(std::uint64_t id, const std::string& load);
  // Those that gRPC is done with, whether they had a place or not.
  void ended(CallKind, grpc::StatusCode);
  struct Counts {
    std::uint64_t open = 0;
    std::array<std::uint64_t, kRefusals> refused{};     // since the start
    std::map<grpc::StatusCode, std::uint64_t> ended{};  // the same
  };
  std::array<Counts, kCallKinds> counts() const;  // by kind
  // Returns once no call is left, or at `deadline`.
  void wait_until_none(Clock::time_point deadline);

 private:
  enum class State { kStarting, kOpen, kLeaving, kClosed, kMoving, kDraining };
  std::size_t most(CallKind) const;
  void advance(State);
  // Throws Error(kUnavailable) in a state before kOpen or after `last`.
  static void require_within(State, State last);
  std::uint64_t& refused(CallKind kind, Refusal why) {
    return counts_[static_cast<std::size_t>(kind)].refused[static_cast<std::size_t>(why)];
  }
  struct Place {
    CallKind kind;
    std::weak_ptr<Served> call;
    std::string client;
    std::optional<Clock::time_point> begun;  // none: it was given back, or its call is refused
  };
  void give_back(Place&);
  void leave(std::uint64_t id);
  std::string again(CallKind, std::size_t places) const;
  void look_after_calls();
  const Limits limits_;
  std::atomic<State> state_{State::kStarting};
  mutable std::mutex mutex_;
  std::condition_variable entered_, left_;
  std::map<std::uint64_t, Place> places_;
  std::array<Counts, kCallKinds> counts_;    // but `open`
  std::array<double, kCallKinds> held_s_{};  // mean time that a place was held, late ones most; 0: none was
  std::uint64_t next_id_ = 1;
  bool stop_ = false;
  std::thread looking_;
};

}  // namespace teletact::service
