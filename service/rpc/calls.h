// Who is being served: limits on long calls, idle ones, and drain. Thread-safe.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <thread>

#include "service/limits/limits.h"

namespace teletact::service {

enum class CallKind { kTouch, kWatch, kEstimate };

class Calls {
 public:
  using Clock = std::chrono::steady_clock;

  // One call, counted while the ticket lives.
  class Ticket {
   public:
    ~Ticket();
    Ticket(const Ticket&) = delete;
    Ticket& operator=(const Ticket&) = delete;
    std::uint64_t id() const { return id_; }
    void active();  // the client was heard
    bool idle() const { return idle_.load(); }

   private:
    friend class Calls;
    Ticket(Calls* calls, CallKind kind, std::uint64_t id);
    Calls* calls_;
    CallKind kind_;
    std::uint64_t id_;
    std::function<void()> on_drain_, on_idle_;
    std::atomic<Clock::rep> heard_;
    std::atomic<bool> idle_{false};
  };

  explicit Calls(const Limits&);
  ~Calls();

  // Calls are refused with Error(kUnavailable) before open() and after drain().
  void open();
  void require_open() const;
  // `on_drain` and `on_idle` are called at most once each, from another thread, while the ticket lives; they
  // must not block or destroy the ticket. Throws Error(kUnavailable | kExhausted).
  std::unique_ptr<Ticket> enter(CallKind, std::function<void()> on_drain, std::function<void()> on_idle);
  bool draining() const { return state_.load() == State::kDraining; }
  void drain();
  std::size_t count() const;
  // Returns once no call is left, or at `deadline`.
  void wait_until_none(Clock::time_point deadline);

 private:
  enum class State { kStarting, kOpen, kDraining };
  std::size_t most(CallKind) const;
  Clock::duration longest_silence(CallKind) const;
  void look_for_idle_calls();
  const Limits limits_;
  std::atomic<State> state_{State::kStarting};
  mutable std::mutex mutex_;
  std::condition_variable stopping_, left_;
  std::map<std::uint64_t, Ticket*> tickets_;
  std::uint64_t next_id_ = 1;
  bool stop_ = false;
  std::thread janitor_;
};

}  // namespace teletact::service
