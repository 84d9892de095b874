// Any stream of answers and contact laws: the bounds of bench/fuzz/fuzz.h hold; and for each renderer enough
// of it reached a limit for that to say something.
#include <cstdio>

#include "bench/fuzz/fuzz.h"
#include "bench/suites/stability/stability.h"

namespace teletact::bench {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(FuzzShares, renderer, cases, answers, pieces, hostile_answers,
                                   hostile_readings, hostile_laws, non_zero, slew_limited, at_largest, by_law,
                                   fading, silent, after_no_number, non_zero_after)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(FuzzResult, cases, not_finite, too_large, too_fast, above_cap, grown,
                                   in_silence, overdrawn, renderers)

namespace {

void promise(const FuzzShares& one, Promises& promises) {
  const double non_zero = one.share(one.non_zero), slewed = one.share(one.slew_limited);
  const double largest = one.share(one.at_largest);
  std::printf(
      "  %-13s %zu answers and %zu pieces of laws, force in %.3f of the ticks, by a law in %.3f, "
      "slew-limited %.4f, F_max %.4f\n",
      one.renderer.c_str(), one.answers, one.pieces, non_zero, one.share(one.by_law), slewed, largest);
  const auto least = [&](const char* what, double value, double least) {
    promises.push_back({snake_case("fuzzed " + one.renderer + " " + what), value, least, "of ticks", false});
  };
  least("with a force", non_zero, FuzzShares::kNonZeroMin);
  least("slew-limited", slewed, FuzzShares::kSlewLimitedMin);
  least("at the largest force", largest, FuzzShares::kAtLargestMin);
  least("with a force after a position that was no number", one.again(), FuzzShares::kAgainMin);
  if (one.renderer == "law") least("by a law", one.share(one.by_law), FuzzShares::kByLawMin);
  least("with a force while not enabled", one.share(one.fading), FuzzShares::kFadingMin);
  least("in silence past every limit", one.share(one.silent), FuzzShares::kSilentMin);
}

FuzzResult measure(bool quick, Promises& promises) {
  const FuzzResult result = fuzz_forces(quick ? 2'000'000 : 10'000'000, 5);
  std::printf("\nfuzzed answers: %zu servo ticks, %zu violations\n", result.cases, result.violations());
  // Forces not finite, above F_max or the stiffness cap, past the slew, growing while not ENABLED, in
  // silence; ledgers overdrawn.
  promises.push_back({"fuzzed_ticks_that_violate_a_bound", double(result.violations()), 0, "ticks"});
  for (const FuzzShares& one : result.renderers) promise(one, promises);
  return result;
}

}  // namespace

Part stability_fuzz() {
  return make_part("fuzz", measure);
}

}  // namespace teletact::bench
