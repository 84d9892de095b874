#include "service/imaging/modulus/modulus_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "service/base/choices.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

constexpr double kSquareM = 0.010;  // about what a finger feels
constexpr double kMaxTolerance = 0.1;
constexpr double kMaxNoise = 0.2;  // of the strain: expected_error() was fitted up to it

std::string percent(double part) {
  return fmt::format("{:.1f} %", 100 * part);
}

int count(double times) {
  return static_cast<int>(std::clamp(times, 0.0, 1e6));
}

}  // namespace

void ModulusBudget::restrict_to(const ModulusBudget& other) {
  if (other.start < start || (other.start == start && other.steps < steps)) why_steps = other.why_steps;
  if (other.solves < solves) why_solves = other.why_solves;
  start = start && other.start, steps = std::min(steps, other.steps), solves = std::min(solves, other.solves);
}

ModulusBudget ModulusCost::within(double left_s, const std::string& why) const {
  constexpr double kLonger = 1.25;  // than expected
  // What says how well its answer is known takes as long as a step.
  ModulusBudget out{direct_s <= left_s, count((left_s - direct_s) / (kLonger * step_s) - 1),
                    count(left_s / (kLonger * solve_s)), why, why};
  if (!out.start)
    out.why_steps += fmt::format(", and the iterative method takes {:.2f} s at least", direct_s);
  return out;
}

Unevenness unevenness(const Field& modulus, double background, const ImageGrid& grid) {
  const auto nodes = [](double spacing_m) {
    return std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(kSquareM / spacing_m)));
  };
  const std::size_t wide = std::min(nodes(grid.dx_m), grid.nx), high = std::min(nodes(grid.dy_m), grid.ny);
  Unevenness out{NAN, NAN};
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
      out.stiff = std::fmax(std::fmax(out.stiff, sum / count), 0);
      out.soft = std::fmax(std::fmax(out.soft, -sum / count), 0);
    }
  return out;
}

double noise_of(const Measured& m) {
  std::vector<float> noise;
  for (std::size_t n = 0; n < m.grid.size(); ++n)
    if (m.strain_valid[n] && m.axial_strain[n] != 0)
      noise.push_back(m.axial_strain_noise[n] / std::abs(m.axial_strain[n]));
  return noise.empty() ? NAN : median(noise);
}

double expected_error(ModulusKind kind, const Unevenness& uneven, double noise) {
  if (!(noise <= kMaxNoise) || std::isnan(uneven.stiff)) return HUGE_VAL;
  // T3.8: 0.032 + 0.36 s + w + m and 0.010 + w + m, m = min(n, max(s, w)): noise takes off no more than there
  // is to see.
  const double both = uneven.soft + std::min(noise, std::max(uneven.stiff, uneven.soft));
  return kind == ModulusKind::kReferenceStress ? 0.032 + 0.36 * uneven.stiff + both : 0.010 + both;
}

ModulusPlan plan_modulus(const ModulusNeed& need, double noise, const Unevenness& uneven,
                         const ModulusBudget& budget) {
  const double tolerance = std::max(need.tolerance, std::min(need.common / 2, kMaxTolerance));
  const double reference = expected_error(ModulusKind::kReferenceStress, uneven, noise),
               iterative = expected_error(ModulusKind::kIterative, uneven, noise);
  std::string allowed = fmt::format("{} is asked for", percent(tolerance));
  if (tolerance > need.tolerance)
    allowed += fmt::format(", as force sensor and contact area are uncertain by {}", percent(need.common));
  if (reference <= tolerance)
    return {ModulusKind::kReferenceStress, tolerance,
            fmt::format("a force computed from reference stress may be off by {} here; {}",
                        percent(reference), allowed)};
  const bool known = std::isfinite(iterative);
  std::string off =
      noise > kMaxNoise
          ? fmt::format("the strain's noise of {} is too much to say by how much it is off", percent(noise))
          : "too little was measured to say by how much it is off";
  if (!budget.start) {
    if (known)
      off = fmt::format(
          "a force computed from reference stress may be off by {} here, from the iterative method by {}",
          percent(reference), percent(iterative));
    return {ModulusKind::kReferenceStress, tolerance,
            fmt::format("{}; {}; {}", budget.why_steps, off, allowed)};
  }
  if (known)
    off = fmt::format("a force computed from the iterative method may be off by {} here, {}",
                      percent(iterative),
                      iterative <= tolerance ? "from reference stress by " + percent(reference)
                                             : "and no other method is better");
  return {ModulusKind::kIterative, tolerance, fmt::format("{}; {}", off, allowed)};
}

}  // namespace teletact::service
