// What is logged while one of these lives, read from any thread.
#pragma once

#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

namespace teletact::test {

class KeptLog {
 public:
  explicit KeptLog(std::unique_ptr<spdlog::formatter> formatter = by_pattern("%v")) {
    sink_->set_formatter(std::move(formatter));
    spdlog::set_default_logger(std::make_shared<spdlog::logger>("kept", sink_));
  }
  ~KeptLog() { spdlog::set_default_logger(usual_); }
  KeptLog(const KeptLog&) = delete;
  KeptLog& operator=(const KeptLog&) = delete;

  static std::unique_ptr<spdlog::formatter> by_pattern(const std::string& pattern) {
    return std::make_unique<spdlog::pattern_formatter>(pattern);
  }
  std::string text() const { return sink_->text(); }
  bool has(const std::string& words, int times = 1) const {
    const std::string all = text();
    std::size_t at = 0;
    for (; times > 0 && (at = all.find(words, at)) != std::string::npos; --times) at += words.size();
    return times == 0;
  }
  // Waits for the words, until they were said so often; false when they have not come within 20 s.
  bool comes(const std::string& words, int times = 1) const {
    for (int n = 0; n < 2000 && !has(words, times); ++n)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return has(words, times);
  }

 private:
  class Sink final : public spdlog::sinks::base_sink<std::mutex> {
   public:
    std::string text() {
      const std::lock_guard lock(mutex_);
      return text_;
    }

   private:
    void sink_it_(const spdlog::details::log_msg& message) override {
      spdlog::memory_buf_t line;
      formatter_->format(message, line);
      text_.append(line.data(), line.size());
    }
    void flush_() override {}
    std::string text_;
  };
  const std::shared_ptr<Sink> sink_ = std::make_shared<Sink>();
  const std::shared_ptr<spdlog::logger> usual_ = spdlog::default_logger();
};

}  // namespace teletact::test
