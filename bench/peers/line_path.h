// Whole-sample displacement of RF lines by dynamic programming, Rivaz, Boctor, Foroughi, Zellars, Fichtinger,
// Hager 2008, "Ultrasound elastography: a dynamic programming approach", IEEE TMI 27(10):1373-1377,
// doi 10.1109/TMI.2008.917243: |pre - post| plus the squared steps from sample to sample and from line to
// line.
#pragma once

#include <vector>

#include "tests/reference/ncc.h"

namespace teletact::bench {

struct PathOptions {
  int axial_reach = 0, lateral_reach = 0;  // of the first line, samples and lines
  double max_strain = 0;                   // |axial lag| <= max_strain * (sample + first_sample) + 2
  double first_sample = 0;                 // depth of sample 0, samples
  double step_cost = 0.2;                  // of a step by one; images scaled to a largest value of 1
};

// Lags [sample + samples * line]. The middle line is searched over the whole range, its neighbours outwards
// around the line before (Rivaz et al. 2011, doi 10.1109/TMI.2010.2091966).
struct Paths {
  std::vector<int> axial, lateral;
};
Paths find_line_paths(const reference::RfImage& pre, const reference::RfImage& post, const PathOptions&);

}  // namespace teletact::bench
