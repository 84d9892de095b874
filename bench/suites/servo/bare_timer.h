// A thread that wakes each millisecond and does nothing, with the servo's own scheduling and sleep: what this
// machine loses of a 1 kHz loop whoever runs it (other threads, its kernel, the host of a virtual machine).
#pragma once

#include <atomic>
#include <cstdint>
#include <thread>
#include <vector>

namespace teletact::bench {

class BareTimer {
 public:
  // Starts; `longest_s` is as long as it will be asked to run at most (memory is taken beforehand).
  explicit BareTimer(double longest_s);
  ~BareTimer();
  BareTimer(const BareTimer&) = delete;
  BareTimer& operator=(const BareTimer&) = delete;
  void stop();

  // After stop().
  double rate_hz() const;
  std::uint64_t overruns() const;  // woken more than 1 ms late, as the servo counts
  const std::vector<double>& lateness_s() const { return lateness_s_; }  // [wake-up]

 private:
  void run();

  std::atomic<bool> stop_{false};
  std::int64_t begin_ns_ = 0, end_ns_ = 0;
  std::vector<double> lateness_s_;
  std::thread thread_;
};

}  // namespace teletact::bench
