// The tactile images of one touch stream: made beside its answers, at a rate of their own, and taken with a
// later one. No answer waits for an image.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "service/contact/tactile_image.h"
#include "service/contact/touch_model.h"

namespace teletact::service {

// Work beside the answers of a touch stream: one piece at a time, and no sooner than a period after the last
// was begun.
// By one thread; the work is done by another, and may outlive this.
class PacedJob {
 public:
  using Clock = std::chrono::steady_clock;

  bool due(Clock::time_point now) const {
    return now >= due_ && under_way_.use_count() == 1;  // else the work has it too
  }
  // Has it done by `work`, or in place where there is none.
  void begin(Clock::time_point now, Clock::duration period, std::function<void()> job, const TouchWork& work,
             const std::string& client) {
    due_ = now + period;
    auto held = [under_way = under_way_, job = std::move(job)] { job(); };
    if (work)
      work(client, std::move(held));
    else
      held();
  }

 private:
  struct Token {};
  const std::shared_ptr<Token> under_way_ = std::make_shared<Token>();
  Clock::time_point due_{};
};

struct SentTactile {
  std::uint64_t sequence = 0;  // of the pose whose contact it shows
  TactileImage image;
  std::chrono::nanoseconds took{};
};

// By one thread; the images are made by another.
class TactileOutbox {
 public:
  using Clock = PacedJob::Clock;
  static constexpr std::size_t kMaxTaxels = 32;  // a side
  static constexpr double kMinPitchM = 0.0005, kMaxPitchM = 0.01;

  // Throws std::invalid_argument (field named).
  explicit TactileOutbox(const TaxelGrid&);
  const TaxelGrid& grid() const { return grid_; }
  // Whether the next may be begun: none is being made, and the last was begun a period ago.
  bool due(Clock::time_point now) const { return job_.due(now); }
  // Has it made by `work`, or in place where there is none.
  void begin(Clock::time_point now, std::uint64_t sequence, std::function<TactileImage()> make,
             const TouchWork& work, const std::string& client);
  // The newest that is ready, once.
  std::optional<SentTactile> take();

 private:
  // Shared with the work, which may outlive the stream.
  struct Slot {
    std::mutex mutex;
    std::optional<SentTactile> ready;
  };
  const TaxelGrid grid_;
  const std::shared_ptr<Slot> slot_ = std::make_shared<Slot>();
  PacedJob job_;
};

}  // namespace teletact::service
