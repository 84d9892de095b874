// Any stream of answers: finite, bounded, no step beyond the slew limit.
#include <cstdio>

#include "bench/stability/fuzz.h"
#include "bench/suites/stability.h"

namespace teletact::bench {
namespace {

nlohmann::json measure(bool quick, std::vector<Target>& targets) {
  const FuzzResult result = fuzz_forces(quick ? 100'000 : 1'000'000, 5);
  std::printf("\nfuzzed answers: %zu cases, %zu violations\n", result.cases, result.violations());
  targets.push_back({"fuzzed answers: forces not finite, above F_max or past the slew",
                     double(result.violations()), 0, "cases"});
  return {{"cases", result.cases},
          {"not_finite", result.not_finite},
          {"too_large", result.too_large},
          {"too_fast", result.too_fast}};
}

}  // namespace

StabilityPart stability_fuzz() {
  return {"fuzz", measure, nullptr};
}

}  // namespace teletact::bench
