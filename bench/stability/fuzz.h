// Any stream of answers whatever, tame and hostile, through every renderer and the safety chain: what comes
// out must be finite, no larger than F_max, and change no faster than the slew limit.
#pragma once

#include <cstddef>
#include <cstdint>

namespace teletact::bench {

struct FuzzResult {
  std::size_t cases = 0;
  std::size_t not_finite = 0, too_large = 0, too_fast = 0;
  std::size_t violations() const { return not_finite + too_large + too_fast; }
};

FuzzResult fuzz_forces(std::size_t cases, std::uint64_t seed);

}  // namespace teletact::bench
