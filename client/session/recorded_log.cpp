#include "client/session/recorded_log.h"

#include <spdlog/sinks/base_sink.h>

#include <algorithm>
#include <mutex>
#include <string>

#include "client/clock/clock.h"

namespace teletact::client {
namespace {

class Lines : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit Lines(RecordWriter& writer) : writer_(writer) {}

 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    v1::RecordEntry entry;
    entry.set_monotonic_ns(monotonic_ns());
    entry.mutable_log()->set_warning(message.level >= spdlog::level::warn);
    entry.mutable_log()->set_text(std::string(message.payload.data(), message.payload.size()));
    writer_.append(std::move(entry));
  }
  void flush_() override {}

 private:
  RecordWriter& writer_;
};

}  // namespace

RecordedLog::RecordedLog(RecordWriter& writer)
    : logger_(spdlog::default_logger()), lines_(std::make_shared<Lines>(writer)) {
  logger_->sinks().push_back(lines_);
}

RecordedLog::~RecordedLog() {
  auto& sinks = logger_->sinks();
  sinks.erase(std::remove(sinks.begin(), sinks.end(), lines_), sinks.end());
}

}  // namespace teletact::client
