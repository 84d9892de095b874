#include "service/imaging/modulus/modulus_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "service/plan/choices.h"

namespace teletact::service {
namespace {

constexpr double kSquareM = 0.010;  // about what a finger feels
constexpr double kMostTolerance = 0.1;
constexpr double kShownNoise = 0.4;  // of the strain's noise, what the squares that are most off show of it

// 95 % of what a finger feels is within even + min(of_stiff stiff, most_of_stiff) + of_soft soft, and
// of_noise times the strain's noise beside it.
struct Expected {
  double even, of_stiff, most_of_stiff, of_soft, of_noise;
};
constexpr Expected kReferenceStress{0.034, 0.4, HUGE_VAL, 0.8, 0.5}, kIterative{0.018, 0.4, 0.08, 0.6, 0.2};

std::string percent(double part) {
  return fmt::format("{:.1f} %", 100 * part);
}

}  // namespace

Unevenness unevenness(const Field& modulus, double background, const ImageGrid& grid) {
  const auto nodes = [](double spacing_m) {
    return std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(kSquareM / spacing_m)));
  };
  const std::size_t wide = std::min(nodes(grid.dx_m), grid.nx), high = std::min(nodes(grid.dy_m), grid.ny);
  Unevenness out;
  for (std::size_t top = 0;
       top + high <= grid.ny && grid.y_m(grid.nx * (top + high - 1)) < choices::kFeltDepth;
       top += std::max<std::size_t>(1, high / 4))
    for (std::size_t left = 0; left + wide <= grid.nx; left += std::max<std::size_t>(1, wide / 4)) {
      double sum = 0, count = 0;
      for (std::size_t j = top; j < top + high; ++j)
        for (std::size_t i = left; i < left + wide; ++i)
          if (const double e = modulus[i + grid.nx * j]; std::isfinite(e))
            sum += std::log(e / background), ++count;
      if (2 * count < static_cast<double>(wide * high)) continue;
      out.stiff = std::max(out.stiff, sum / count), out.soft = std::max(out.soft, -sum / count);
    }
  return out;
}

double expected_error(ModulusKind kind, const Unevenness& uneven, double noise) {
  const Expected& e = kind == ModulusKind::kReferenceStress ? kReferenceStress : kIterative;
  const auto beyond_noise = [noise](double off) { return std::max(0.0, off - kShownNoise * noise); };
  return std::hypot(e.even + std::min(e.of_stiff * beyond_noise(uneven.stiff), e.most_of_stiff) +
                        e.of_soft * beyond_noise(uneven.soft),
                    e.of_noise * noise);
}

ModulusPlan plan_modulus(const ModulusNeed& need, double noise, const Unevenness& uneven,
                         const ModulusTime& time) {
  const double tolerance = std::max(need.tolerance, std::min(need.common / 2, kMostTolerance));
  const double reference = expected_error(ModulusKind::kReferenceStress, uneven, noise),
               iterative = expected_error(ModulusKind::kIterative, uneven, noise);
  const double start_s = time.expected_s[static_cast<std::size_t>(ModulusKind::kDirect)];
  std::string asked = fmt::format("{} of the force may be off by the modulus", percent(tolerance));
  if (tolerance > need.tolerance)
    asked += fmt::format(": force sensor and contact area leave {} open", percent(need.common));
  if (reference <= tolerance)
    return {ModulusKind::kReferenceStress, tolerance,
            fmt::format("reference stress is good enough here ({}); {}", percent(reference), asked)};
  if (time.left_s && start_s > *time.left_s)
    return {
        ModulusKind::kReferenceStress, tolerance,
        fmt::format("{:.2f} s are left of {}, and the iterative method takes {:.2f} s at least: reference "
                    "stress, off by about {} instead of {}; {}",
                    std::max(0.0, *time.left_s), time.words, start_s, percent(reference), percent(iterative),
                    asked)};
  return {ModulusKind::kIterative, tolerance,
          fmt::format("{} ({}); {}",
                      iterative <= tolerance
                          ? "iterative, since reference stress is not good enough here"
                          : "iterative, the best there is, and not good enough everywhere here",
                      iterative <= tolerance ? percent(reference) : percent(iterative), asked)};
}

}  // namespace teletact::service
