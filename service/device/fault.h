// A device that no longer takes work, for tests: while it is set every launch fails, on every device or on
// those of one number (DeviceOptions).
#pragma once

#include <cstddef>
#include <optional>

namespace teletact::service {

void fail_launches(bool fail, std::optional<std::size_t> number = std::nullopt);

}  // namespace teletact::service
