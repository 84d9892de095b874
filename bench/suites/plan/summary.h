// What the pairs of the plan chart come to: of models, of classes of pairs, and of what a planner takes.
#pragma once

#include <string>
#include <vector>

#include "bench/suites/plan/figures.h"

namespace teletact::bench::plan {

// Whether the truth is within what the answer states.
bool within_budget(const Answer&);
// The name of the model that a planner takes at a tolerance.
std::string planned_name(const Planned&);

// From the pairs, and printed. Throws BenchError where there are none.
void sum_up(Figures&);

}  // namespace teletact::bench::plan
