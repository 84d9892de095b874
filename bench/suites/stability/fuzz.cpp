// Any stream of answers: the bounds of bench/fuzz/fuzz.h hold; and for each renderer enough of it reached a
// limit for that to say something.
#include <cstdio>

#include "bench/fuzz/fuzz.h"
#include "bench/suites/stability/stability.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

json shares(const FuzzShares& one, std::vector<Target>& targets) {
  const double non_zero = one.share(one.non_zero), slewed = one.share(one.slew_limited);
  const double largest = one.share(one.at_largest);
  std::printf("  %-13s force in %.3f of them, slew-limited %.4f, F_max %.4f\n", one.renderer.c_str(),
              non_zero, slewed, largest);
  const auto least = [&](const char* what, double value, double least) {
    targets.push_back({"fuzzed answers, " + one.renderer + ": " + what, value, least, "of ticks", false});
  };
  least("a force is written", non_zero, FuzzShares::kNonZeroLeast);
  least("slew-limited", slewed, FuzzShares::kSlewLimitedLeast);
  least("at F_max", largest, FuzzShares::kAtLargestLeast);
  least("a force again after a position that was no number", one.again(), FuzzShares::kAgainLeast);
  least("a force while not ENABLED", one.share(one.fading), FuzzShares::kFadingLeast);
  least("silence past every limit", one.share(one.silent), FuzzShares::kSilentLeast);
  return {{"renderer", one.renderer},
          {"cases", one.cases},
          {"hostile_answers", one.hostile_answers},
          {"hostile_readings", one.hostile_readings},
          {"non_zero", one.non_zero},
          {"slew_limited", one.slew_limited},
          {"at_largest", one.at_largest},
          {"fading", one.fading},
          {"silent", one.silent},
          {"after_no_number", one.after_no_number},
          {"non_zero_after", one.non_zero_after}};
}

json measure(bool quick, std::vector<Target>& targets) {
  const FuzzResult result = fuzz_forces(quick ? 400'000 : 4'000'000, 5);
  std::printf("\nfuzzed answers: %zu servo ticks, %zu violations\n", result.cases, result.violations());
  targets.push_back(
      {"fuzzed answers: forces not finite, above F_max or the stiffness cap, past the slew, growing "
       "while not ENABLED, or in silence",
       double(result.violations()), 0, "cases"});
  json renderers = json::array();
  for (const FuzzShares& one : result.renderers) renderers.push_back(shares(one, targets));
  return {{"cases", result.cases},           {"not_finite", result.not_finite},
          {"too_large", result.too_large},   {"too_fast", result.too_fast},
          {"above_cap", result.above_cap},   {"grown", result.grown},
          {"in_silence", result.in_silence}, {"renderers", renderers}};
}

}  // namespace

StabilityPart stability_fuzz() {
  return {"fuzz", measure, nullptr};
}

}  // namespace teletact::bench
