// How lines of the log look.
#pragma once

#include <spdlog/formatter.h>

#include <memory>

namespace teletact::service {

// key=value, the time in UTC first, and last trace=HEX where the thread that writes the line works for a
// trace (current_trace.h).
std::unique_ptr<spdlog::formatter> log_formatter();

}  // namespace teletact::service
