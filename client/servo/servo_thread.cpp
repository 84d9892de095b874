#include "client/servo/servo_thread.h"

#include <chrono>
#include <utility>

#include "client/clock/clock.h"
#include "client/servo/ending.h"
#include "client/servo/tick_watch.h"

namespace teletact::client {

ServoThread::ServoThread(ServoLoop& servo, Options options)
    : servo_(servo), options_(std::move(options)), thread_([this] { run(); }) {}

ServoThread::~ServoThread() {
  join();
}

void ServoThread::join() noexcept {
  stop_ = true;
  MonotonicClock clock;
  TickWatch watch;
  while (!over()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    const double now_s = seconds(clock.now_ns());
    if (looping() && watch.still_s(servo_.ticks(), now_s) >= TickWatch::kStuckS)
      end_now(kStuckCode,
              "teletact-client: the device's adapter did not return from a call: it was asked to let go, "
              "and this process ends without it\n");
  }
  if (thread_.joinable()) thread_.join();
}

void ServoThread::stop() {
  join();
  if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
}

std::optional<RealTime> ServoThread::real_time() const {
  if (!granted_known_.load(std::memory_order_acquire)) return std::nullopt;
  return granted_;
}

// The loop itself throws nothing; what is called around it may.
void ServoThread::run() noexcept {
  try {
    if (options_.real_time) {
      granted_ = ask_for_real_time(&servo_, sizeof servo_);
      granted_known_.store(true, std::memory_order_release);
    }
    options_.begins();
    looping_.store(true, std::memory_order_release);
    servo_.run(stop_);
    looping_.store(false, std::memory_order_release);
    options_.ended();
  } catch (...) {
    error_ = std::current_exception();
  }
  over_.store(true, std::memory_order_release);
}

}  // namespace teletact::client
