// What a fit says for people of the tissue that it found.
#pragma once

#include <vector>

#include "service/imaging/modulus/probe_fit.h"
#include "service/imaging/modulus/weighed_tissues.h"

namespace teletact::service {

// All tissues of one kind, by the likeliest of them.
struct WeighedKind {
  const CandidateTissue* of;
  const TissueWindow* window;
  double weight;
};

// Sets `words` and `contradicted` of what is fitted else. `order`: the likeliest first; `fitted`: whether
// more than what is stated was tried; `grading` of ln E; `above_m`: of the tissue's depth as it is stated,
// what is no tissue.
void put_into_words(const std::vector<WeighedKind>& order, bool fitted, double grading, double above_m,
                    ProbeFit&);

}  // namespace teletact::service
