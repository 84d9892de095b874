#include "client/servo/servo_thread.h"

#include <utility>

namespace teletact::client {

ServoThread::ServoThread(ServoLoop& servo, Options options)
    : servo_(servo), options_(std::move(options)), thread_([this] { run(); }) {}

ServoThread::~ServoThread() {
  stop_ = true;
  if (thread_.joinable()) thread_.join();
}

void ServoThread::stop() {
  stop_ = true;
  if (thread_.joinable()) thread_.join();
  if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
}

std::optional<RealTime> ServoThread::real_time() const {
  if (!asked_.load(std::memory_order_acquire)) return std::nullopt;
  return granted_;
}

// The loop itself throws nothing; what is called around it may.
void ServoThread::run() noexcept {
  try {
    if (options_.real_time) {
      granted_ = ask_for_real_time(&servo_, sizeof servo_);
      asked_.store(true, std::memory_order_release);
    }
    options_.begins();
    servo_.run(stop_);
    options_.ended();
  } catch (...) {
    error_ = std::current_exception();
  }
  over_.store(true, std::memory_order_release);
}

}  // namespace teletact::client
