#include "bench/suites/servo/bare_timer.h"

#include <algorithm>

#include "client/clock/clock.h"
#include "client/servo/realtime.h"
#include "client/servo/servo_loop.h"

namespace teletact::bench {
namespace {

constexpr std::int64_t kPeriodNs = 1'000'000;

}  // namespace

BareTimer::BareTimer(double longest_s) {
  lateness_s_.reserve(static_cast<std::size_t>(longest_s * 1e9 / static_cast<double>(kPeriodNs)));
  thread_ = std::thread([this] { run(); });
}

BareTimer::~BareTimer() {
  stop();
}

void BareTimer::stop() {
  stop_ = true;
  if (thread_.joinable()) thread_.join();
}

void BareTimer::run() {
  client::ask_for_real_time(this, sizeof *this);
  client::MonotonicClock clock;
  begin_ns_ = end_ns_ = clock.now_ns();
  std::int64_t due_ns = begin_ns_ + kPeriodNs;
  while (!stop_.load(std::memory_order_relaxed) && lateness_s_.size() < lateness_s_.capacity()) {
    clock.sleep_until_ns(due_ns);
    end_ns_ = clock.now_ns();
    lateness_s_.push_back(1e-9 * static_cast<double>(end_ns_ - due_ns));
    do due_ns += kPeriodNs;
    while (due_ns < end_ns_);  // what is past is skipped, as in the servo
  }
}

double BareTimer::rate_hz() const {
  return 1e9 * static_cast<double>(lateness_s_.size()) / static_cast<double>(end_ns_ - begin_ns_);
}

std::uint64_t BareTimer::overruns() const {
  const double limit_s = client::ServoOptions{}.overrun_s;
  return static_cast<std::uint64_t>(
      std::count_if(lateness_s_.begin(), lateness_s_.end(), [&](double s) { return s > limit_s; }));
}

}  // namespace teletact::bench
