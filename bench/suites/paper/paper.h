// teletact-bench paper: the paper's experiments (T6), one part each.
#pragma once

#include "bench/run_suite.h"

namespace teletact::bench {

Part paper_fig14();         // T6.1
Part paper_fig15();         // T6.2
Part paper_fig16();         // T6.3
Part paper_psychometric();  // T6.4
Part paper_slices();        // T8.7

}  // namespace teletact::bench
