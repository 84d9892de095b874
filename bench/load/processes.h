// A load by several processes of this program.
#pragma once

#include "bench/load/tally.h"
#include "bench/load/worker.h"

namespace teletact::bench {

// The subcommand of this program that runs the plan in a file, and prints its Tally as JSON.
inline constexpr const char* kLoadWorker = "load-worker";

// The plan's clients shared out; its first_client and begin_ns are set here. Throws std::runtime_error (one
// line).
Tally run_processes(LoadPlan, unsigned processes);

}  // namespace teletact::bench
