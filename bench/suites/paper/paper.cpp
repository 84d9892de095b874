// teletact-bench paper fig14|fig15|fig16|psychometric|slices|all: the paper's experiments again, ours beside
// theirs.
#include "bench/suites/paper/paper.h"

namespace teletact::bench {

void add_paper_suite(CLI::App& app, bool& met) {
  add_suite(
      app, "paper", "the source paper's experiments, ours beside theirs",
      "fig14: what the Kalman filter does to the stiffness (T6.1); fig15: time to solve and communicate "
      "(T6.2); fig16: touching under the surface (T6.3); psychometric: the fits of its tables and "
      "simulated observers (T6.4); slices: a volume becomes touchable slice by slice (T8.7)",
      {paper_fig14(), paper_fig15(), paper_fig16(), paper_psychometric(), paper_slices()}, met);
}

}  // namespace teletact::bench
