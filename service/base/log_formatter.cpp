#include "service/base/log_formatter.h"

#include <fmt/format.h>
#include <spdlog/pattern_formatter.h>

#include <iterator>

#include "service/base/current_trace.h"

namespace teletact::service {
namespace {

class TraceOfTheLine final : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg&, const std::tm&, spdlog::memory_buf_t& line) override {
    if (const TraceId trace = current_trace())
      fmt::format_to(std::back_inserter(line), " trace={}", hex(trace));
  }
  std::unique_ptr<custom_flag_formatter> clone() const override { return std::make_unique<TraceOfTheLine>(); }
};

}  // namespace

std::unique_ptr<spdlog::formatter> log_formatter() {
  auto lines = std::make_unique<spdlog::pattern_formatter>(spdlog::pattern_time_type::utc);
  lines->add_flag<TraceOfTheLine>('*').set_pattern("time=%Y-%m-%dT%H:%M:%S.%fZ level=%l %v%*");
  return lines;
}

}  // namespace teletact::service
