// Slow calls, for whoever looks for what made them slow: spans in a file. Who tells of one never waits for
// the disk; a thread below touch writes.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "service/trace/otlp.h"
#include "service/trace/span_file.h"

namespace teletact::service {

struct SpansOptions {
  std::filesystem::path file;           // empty: none is written
  std::optional<double> slow_call_s;    // else Spans::kSlowCallS
  std::optional<double> slow_answer_s;  // else Spans::kSlowAnswerS
};

class Spans {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr double kSlowCallS = 1, kSlowAnswerS = 0.05;
  static constexpr double kMostSlowS = 3600;
  static constexpr std::uint64_t kMostFileBytes = 16 << 20;  // then it becomes FILE.1
  static constexpr std::size_t kMostWaiting = 1024;          // further ones are dropped
  static constexpr std::chrono::milliseconds kWriteEvery{500};
  static constexpr std::chrono::seconds kSayEvery{60};  // what fails and works by turns

  // Null where no file is named. Throws std::runtime_error or std::invalid_argument, one line: a file that
  // cannot be written, a time out of its range, or a time without a file.
  static std::unique_ptr<Spans> make(const SpansOptions&, SpanSource);

  ~Spans();  // writes what waits
  Spans(const Spans&) = delete;
  Spans& operator=(const Spans&) = delete;

  bool slow_call(Clock::duration lasted) const { return lasted > slow_call_; }
  // `late`: since the pose came, but for the period that is kept between answers.
  bool slow_answer(Clock::duration late) const { return late > slow_answer_; }

  // `make()` gives the Span. Whatever it throws, the span is dropped. Thread-safe.
  template <class Make>
  void tell(Make&& make) noexcept {
    try {
      put(make());
    } catch (...) {
      ++dropped_;
    }
  }
  std::uint64_t written() const { return written_.load(); }
  std::uint64_t dropped() const { return dropped_.load(); }

 private:
  Spans(const SpansOptions&, SpanSource);
  void put(Span);
  void work();
  // False: the disk does not take it.
  bool write(const Span&, std::chrono::nanoseconds to_wall);
  const Clock::duration slow_call_, slow_answer_;
  const SpanSource source_;
  SpanFile file_;
  // By the thread that writes.
  bool said_ = false;  // that the disk does not take them
  std::optional<Clock::time_point> said_at_;
  std::atomic<std::uint64_t> written_{0}, dropped_{0};
  std::mutex mutex_;
  std::condition_variable stopped_;
  std::vector<Span> waiting_;
  bool stop_ = false;
  std::thread thread_;  // last
};

}  // namespace teletact::service
