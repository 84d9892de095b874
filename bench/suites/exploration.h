// teletact-bench exploration: stalls of an exploring finger (T1).
#pragma once

#include "bench/suite.h"

namespace teletact::bench {

void add_exploration_suite(CLI::App& app, bool& met);

}  // namespace teletact::bench
