// Looks at files that others change, again and again, on a thread of its own. What is wrong with them is
// logged once, and looked at again: they may be right the next time.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <thread>

namespace teletact::service {

class FileWatch {
 public:
  static constexpr std::chrono::milliseconds kLook{500};

  // `look` throws std::exception for what it does not take; `failure`: the log's event then. What `look` uses
  // lives longer than this.
  FileWatch(std::chrono::milliseconds between, const char* failure, std::function<void()> look);
  // How often it looked.
  std::uint64_t looks() const { return looks_.load(); }

 private:
  std::atomic<std::uint64_t> looks_{0};
  std::jthread thread_;
};

}  // namespace teletact::service
