// Any stream of answers whatever, from the message of the contract through the link's conversion and the
// servo loop with its safety chain. What is written to the device must be finite and no larger than F_max,
// nor than the stiffness cap over the indentation, which is nothing in the air; rise no faster than the slew
// limit; never grow while the state is not ENABLED; and be nothing once silence is past every limit. No
// ledger of energy is overdrawn.
//
// Most of it is a plausible touch, or nothing would ever be rendered: a finger that presses and slides,
// answers that are late. Mixed in are hostile answers (no numbers, 1e300, jumps, of the wrong length, out of
// order, stale, from the future) and contact laws (laws.h), a link that falls silent, hostile readings of the
// device (no numbers, jumps, 1e300, none), late ticks, and an operator who pauses. The shares say what of it
// reached the limits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace teletact::bench {

// Of one renderer; each of the later is a count of ticks.
struct FuzzShares {
  // Of the ticks, for a run without violations to say something.
  static constexpr double kNonZeroMin = 0.2, kSlewLimitedMin = 0.0005, kAtLargestMin = 0.003;
  static constexpr double kAgainMin = 0.1;  // of those after a position that was no number
  static constexpr double kFadingMin = 1e-4, kSilentMin = 1e-3, kByLawMin = 0.05;
  std::string renderer;
  std::size_t cases = 0;
  std::size_t answers = 0, pieces = 0;  // of laws, that came
  std::size_t hostile_answers = 0, hostile_readings = 0, hostile_laws = 0;
  std::size_t non_zero = 0;         // a force was written
  std::size_t slew_limited = 0;     // it changed as fast as the slew limit lets it
  std::size_t at_largest = 0;       // it was F_max
  std::size_t by_law = 0;           // a contact law's force was
  std::size_t fading = 0;           // a force while the state was not ENABLED
  std::size_t silent = 0;           // silence past every limit
  std::size_t after_no_number = 0;  // after a position that was no number in the same session
  std::size_t non_zero_after = 0;   // of those with a force
  double again() const { return double(non_zero_after) / double(after_no_number); }
  double share(std::size_t count) const { return double(count) / double(cases); }
};

struct FuzzResult {
  std::size_t cases = 0;
  std::size_t not_finite = 0, too_large = 0, too_fast = 0;
  std::size_t above_cap = 0;  // |F| above stiffness cap x indentation: in the air, any force
  std::size_t grown = 0;      // while the state was not ENABLED
  std::size_t in_silence = 0;
  std::size_t overdrawn = 0;  // a ledger of energy below zero
  std::vector<FuzzShares> renderers;
  std::size_t violations() const {
    return not_finite + too_large + too_fast + above_cap + grown + in_silence + overdrawn;
  }
};

// `cases` servo ticks in sessions of a few seconds each: half of them by law, half shared by the others.
FuzzResult fuzz_forces(std::size_t cases, std::uint64_t seed);

}  // namespace teletact::bench
