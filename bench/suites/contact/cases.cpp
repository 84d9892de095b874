// One factor at a time from the middle (61x61 nodes, nu .49, contrast 10, nodule), and the cases that a
// solver is known to stop converging on.
#include <algorithm>
#include <utility>

#include "bench/suites/contact/contact.h"

namespace teletact::bench {
namespace {

constexpr Pattern kPatterns[] = {Pattern::kNodule, Pattern::kCheckerboard, Pattern::kSponge,
                                 Pattern::kLayered};

std::vector<std::pair<std::size_t, std::size_t>> sizes(bool quick) {
  if (quick) return {{51, 8}, {51, 21}, {41, 41}};
  return {{51, 8}, {51, 21}, {31, 31}, {41, 41}, {81, 81}, {121, 121}, {241, 241}};
}

// Corners of acceptance: (nu, contrast).
void add_robustness(std::vector<ChartCase>& cases, bool quick) {
  for (const auto& [nu, contrast] : {std::pair{0.49, 10.0}, {0.499, 1000.0}, {0.4999, 1000.0}})
    for (const double stretch : {1.0, 5.0})
      for (const Pattern pattern : kPatterns) {
        if (quick && (stretch != 1 || pattern == Pattern::kCheckerboard || pattern == Pattern::kLayered))
          continue;
        ContactCase c{.poisson_ratio = nu, .contrast = contrast, .pattern = pattern, .stretch = stretch};
        cases.push_back({c, {"robustness"}, true});
      }
}

}  // namespace

std::vector<ChartCase> chart_cases(bool quick) {
  const ContactCase middle;
  std::vector<ChartCase> cases{{middle, {"base", "size", "poisson", "contrast", "pattern"}}};
  const auto add = [&](const char* sweep, auto&& change) {
    ContactCase c = middle;
    change(c);
    cases.push_back({c, {sweep}});
  };
  for (const auto& size : sizes(quick))
    add("size", [&](ContactCase& c) { std::tie(c.columns, c.rows) = size; });
  const std::vector<double> ratios =
      quick ? std::vector{0.3, 0.499} : std::vector{0.3, 0.45, 0.495, 0.499, 0.4999};
  for (const double nu : ratios) add("poisson", [&](ContactCase& c) { c.poisson_ratio = nu; });
  const std::vector<double> contrasts = quick ? std::vector{1.0, 1000.0} : std::vector{1.0, 100.0, 1000.0};
  for (const double contrast : contrasts) add("contrast", [&](ContactCase& c) { c.contrast = contrast; });
  for (const Pattern pattern : kPatterns)
    if (pattern != middle.pattern && (!quick || pattern == Pattern::kSponge))
      add("pattern", [&](ContactCase& c) { c.pattern = pattern; });
  add_robustness(cases, quick);
  return cases;
}

}  // namespace teletact::bench
