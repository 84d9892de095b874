// A hand and its link.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "client/link/touch_link.h"
#include "tests/link/fake_palpation.h"

namespace teletact::client::test {

// Poses at 1 kHz as a servo would give them, along the tissue by 1 mm/s, and the newest answer.
class Operator {
 public:
  explicit Operator(const std::string& address, const std::function<void(TouchLinkOptions&)>& change = {}) {
    TouchLinkOptions options;
    options.address = address;
    options.open.set_scene_id("s");
    options.open.set_period_s(0.001);
    options.open.set_credit(2);
    options.dead_s = 1.0;
    if (change) change(options);
    link = std::make_unique<TouchLink>(options, poses, answers, clock);
    servo_ = std::thread([this] {
      std::int64_t due_ns = clock.now_ns();
      for (double x_m = 0.02; !stop_; x_m += 1e-6) {
        ServoPose pose;
        pose.pose.position_m = Vector3(x_m, 0.004, 0);
        pose.time_ns = clock.now_ns();
        pose.by_law = by_law;
        poses.put(pose);
        clock.sleep_until_ns(due_ns += 1'000'000);
      }
    });
    link->start();
  }
  ~Operator() {
    stop_ = true;
    servo_.join();
    link->stop();
  }
  MonotonicClock clock;
  LatestSlot<ServoPose> poses;
  LatestSlot<ServoAnswer> answers;
  std::unique_ptr<TouchLink> link;
  std::atomic<bool> by_law{false};  // as its servo says

 private:
  std::atomic<bool> stop_{false};
  std::thread servo_;
};

inline double seconds_since(std::chrono::steady_clock::time_point then) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - then).count();
}

// True as soon as it is `met`, within `seconds`.
template <typename Met>
bool within(double seconds, Met&& met) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (!met()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return true;
}

}  // namespace teletact::client::test
