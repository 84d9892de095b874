#include "service/base/paced_log.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <iterator>
#include <utility>

namespace teletact::service {

std::string key_values(std::chrono::steady_clock::duration took, const std::vector<StageTime>& stages) {
  using Seconds = std::chrono::duration<double>;
  std::string text = fmt::format("took_s={:.4f}", Seconds(took).count());
  for (const StageTime& stage : stages)
    fmt::format_to(std::back_inserter(text), " {}_s={:.4f}", stage.name, Seconds(stage.took).count());
  return text;
}

void PacedLog::tell(Clock::time_point now, const std::function<std::string()>& what) noexcept try {
  if (const auto left_out = turn(now)) spdlog::warn("event={} {} left_out={}", event_, what(), *left_out);
} catch (...) {
}

std::optional<std::uint64_t> PacedLog::turn(Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  if (said_at_ && now - *said_at_ < pace_) {
    ++left_out_;
    return std::nullopt;
  }
  said_at_ = now;
  return std::exchange(left_out_, 0);
}

}  // namespace teletact::service
