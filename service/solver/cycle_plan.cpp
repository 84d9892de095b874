#include "service/solver/cycle_plan.h"

namespace teletact::service {
namespace {

void smooth(int level, std::size_t steps, bool from_zero, std::vector<PlannedStep>& plan) {
  for (std::size_t k = 0; k < steps; ++k) {
    const bool first = from_zero && k == 0;  // the residual is the right-hand side
    if (!first) plan.push_back({CycleStep::kResidual, level});
    plan.push_back({first ? CycleStep::kSmoothFromZero : CycleStep::kSmooth, level, static_cast<int>(k)});
  }
}

void cycle(int level, int last, std::size_t steps, std::vector<PlannedStep>& plan) {
  if (level == last) {
    plan.push_back({CycleStep::kSolve, level});
    return;
  }
  smooth(level, steps, true, plan);
  const bool twice = level > 0 && level + 1 < last;  // not where the next level is solved exactly
  for (int visit = 0; visit < (twice ? 2 : 1); ++visit) {
    plan.push_back({CycleStep::kResidual, level});
    plan.push_back({CycleStep::kRestrict, level});
    cycle(level + 1, last, steps, plan);
    plan.push_back({CycleStep::kProlong, level});
    smooth(level, steps, false, plan);
  }
}

}  // namespace

std::vector<PlannedStep> plan_cycle(std::size_t levels, std::size_t smoothing_steps) {
  std::vector<PlannedStep> plan{{CycleStep::kPack}};
  cycle(0, static_cast<int>(levels) - 1, smoothing_steps, plan);
  plan.push_back({CycleStep::kUnpack});
  return plan;
}

std::vector<ChebyshevStep> chebyshev_steps(double lowest, double highest, unsigned steps) {
  const double theta = (highest + lowest) / 2, delta = (highest - lowest) / 2, sigma = theta / delta;
  std::vector<ChebyshevStep> out{{0, 1 / theta}};
  double rho = 1 / sigma;
  while (out.size() < steps) {
    const double next = 1 / (2 * sigma - rho);
    out.push_back({next * rho, 2 * next / delta});
    rho = next;
  }
  return out;
}

}  // namespace teletact::service
