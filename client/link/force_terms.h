// What makes the interval of a force as wide as it is (T9.4), and what would make it narrower.
#pragma once

#include <map>
#include <optional>

#include "teletact/v1/palpation.pb.h"

namespace teletact::client {

namespace v1 = ::teletact::v1;

// By how much of the force half of the 95 % interval would be narrower without each.
using ForceTerms = std::map<v1::ForceError::Term, double>;
// Adds those of one more answer.
void add_terms(const v1::ForceBudget& budget, ForceTerms& terms);

struct LargestTerm {
  const char *what, *remedy;
  double by;  // of the terms given
};
// None where there is no term.
std::optional<LargestTerm> largest_term(const ForceTerms& terms);

}  // namespace teletact::client
