// The servo's period, which every simulated display here is stepped by.
#pragma once

#include <cstdint>

namespace teletact::bench {

inline constexpr double kServoS = 0.001;
inline constexpr std::int64_t kServoNs = 1'000'000;

}  // namespace teletact::bench
