// The servo loop on its own thread for as long as this object lives: whatever ends its scope, an exception
// included, takes the force down by the slew limit before anything that the loop borrows is gone. A loop that
// waits for ever in its device's adapter cannot be joined, nor what it borrows be given up: the process ends.
#pragma once

#include <atomic>
#include <exception>
#include <functional>
#include <optional>
#include <thread>

#include "client/servo/open_device.h"
#include "client/servo/realtime.h"
#include "client/servo/servo_loop.h"

namespace teletact::client {

class ServoThread {
 public:
  static constexpr int kStuckCode = 3;  // of a process that ends because its adapter does not return

  struct Options {
    bool real_time = true;  // ask for SCHED_FIFO and locked memory
    // Called on the thread around the loop, by those who measure it.
    std::function<void()> begins = [] {};
    std::function<void()> ended = [] {};
  };

  // Borrows the loop, whose device is open. Throws std::system_error when there is no thread to be had.
  ServoThread(ServoLoop& servo, Options options);
  ~ServoThread();  // as stop(), errors swallowed
  ServoThread(const ServoThread&) = delete;
  ServoThread& operator=(const ServoThread&) = delete;

  // Slews the force to zero and joins; then throws what `begins` or `ended` threw. When the loop makes no
  // tick for TickWatch::kStuckS meanwhile, the process ends by end_now().
  void stop();
  // The loop is to be ticking by now: `begins` is done.
  bool looping() const noexcept { return looping_.load(std::memory_order_acquire); }
  // The loop is over, by stop() or because `begins` threw.
  bool over() const noexcept { return over_.load(std::memory_order_acquire); }
  // What was granted; absent before it is known, or when it was not asked for.
  std::optional<RealTime> real_time() const;

 private:
  void run() noexcept;
  void join() noexcept;

  ServoLoop& servo_;
  Options options_;
  RealTime granted_;
  std::atomic<bool> granted_known_{false};
  std::atomic<bool> stop_{false};
  std::atomic<bool> looping_{false};
  std::atomic<bool> over_{false};
  std::exception_ptr error_;
  std::thread thread_;
};

}  // namespace teletact::client
