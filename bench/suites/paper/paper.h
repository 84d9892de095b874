// teletact-bench paper: the paper's experiments (T6), one part each: figures, targets and pictures.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/suite.h"

namespace teletact::bench {

// One experiment of the paper. `measure` gives its figures and appends what it promises; `draw` makes its
// pictures in the folder from those figures alone.
struct PaperExperiment {
  const char* name;
  nlohmann::json (*measure)(bool quick, std::vector<Target>& targets);
  void (*draw)(const nlohmann::json& figures, const std::string& folder);
};

PaperExperiment paper_psychometric();  // T6.4
PaperExperiment paper_fig14();         // T6.1
PaperExperiment paper_fig15();         // T6.2
PaperExperiment paper_fig16();         // T6.3

}  // namespace teletact::bench
