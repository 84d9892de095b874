// Work beside the answers of a touch stream: one piece at a time, and no sooner than a period after the last
// was begun.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "service/contact/touch_model.h"

namespace teletact::service {

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

}  // namespace teletact::service
