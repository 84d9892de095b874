// While it lives, what the default logger says goes into a recording, too.
#pragma once

#include <spdlog/spdlog.h>

#include <memory>

#include "client/link/recording.h"

namespace teletact::client {

class RecordedLog {
 public:
  // Borrows the writer. Before and after other threads log.
  explicit RecordedLog(RecordWriter& writer);
  ~RecordedLog();
  RecordedLog(const RecordedLog&) = delete;
  RecordedLog& operator=(const RecordedLog&) = delete;

 private:
  std::shared_ptr<spdlog::logger> logger_;
  spdlog::sink_ptr lines_;
};

}  // namespace teletact::client
