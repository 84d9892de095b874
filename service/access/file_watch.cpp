#include "service/access/file_watch.h"

#include <spdlog/spdlog.h>

#include <condition_variable>
#include <exception>
#include <mutex>
#include <string>
#include <utility>

namespace teletact::service {

FileWatch::FileWatch(std::chrono::milliseconds between, const char* failure, std::function<void()> look)
    : thread_([this, between, failure, look = std::move(look)](const std::stop_token& stop) {
        std::mutex mutex;
        std::unique_lock lock(mutex);
        std::condition_variable_any stopped;
        std::string failed;
        while (!stopped.wait_for(lock, stop, between, [&] { return stop.stop_requested(); })) {
          try {
            look();
            if (!std::exchange(failed, {}).empty()) spdlog::info("event={} over=true", failure);
          } catch (const std::exception& error) {
            if (failed != error.what())
              spdlog::error("event={} error=\"{}\" goes_on=\"as it was read before\"", failure, error.what());
            failed = error.what();
          }
          ++looks_;
        }
      }) {}

}  // namespace teletact::service
