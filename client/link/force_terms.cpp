#include "client/link/force_terms.h"

#include <algorithm>
#include <cmath>

namespace teletact::client {
namespace {

using Error = v1::ForceError;

struct TermWords {
  Error::Term term;
  const char *what, *remedy;
};
constexpr TermWords kTermWords[] = {
    {Error::TERM_SOLVER, "the solver", "state a smaller --tolerance"},
    {Error::TERM_MESH, "the nodes' spacing", "make a scene of finer nodes"},
    {Error::TERM_FINITE_STRAIN, "the linear model", "press less deep"},
    {Error::TERM_MODULUS, "the modulus",
     "press the probe further, and state the tissue's size, of a solid its surface, too"},
    {Error::TERM_SLICES, "tissue between the slices", "image one more at the finger"},
    {Error::TERM_MODEL, "the closed form", "use --path gradients"},
    {Error::TERM_DIMENSION, "the plane that stands for a solid", "make a solid scene"},
    {Error::TERM_CONTEXT, "tissue beside what was imaged", "image more of it"}};

}  // namespace

// As the service adds them: deviations and estimates as squares, bounds on top.
void add_terms(const v1::ForceBudget& budget, ForceTerms& terms) {
  constexpr double kOf95 = 1.96, kMost = 1e6;
  double squares = 0;
  const auto add = [&](const auto& what) {
    for (const Error& e : budget.terms())
      if (e.term() != Error::TERM_UNSPECIFIED && Error::Term_IsValid(e.term()) && e.relative() >= 0 &&
          e.relative() <= kMost)
        what(e, e.kind() == Error::KIND_BOUND, e.relative() * e.relative());
  };
  add([&](const Error&, bool bound, double square) { squares += bound ? 0 : square; });
  add([&](const Error& e, bool bound, double square) {
    const double without = std::sqrt(std::max(0.0, squares - square));
    terms[e.term()] += bound ? e.relative() : kOf95 * (std::sqrt(squares) - without);
  });
}

std::optional<LargestTerm> largest_term(const ForceTerms& terms) {
  std::optional<LargestTerm> largest;
  for (const TermWords& words : kTermWords)
    if (const auto at = terms.find(words.term); at != terms.end() && at->second > (largest ? largest->by : 0))
      largest = {words.what, words.remedy, at->second};
  return largest;
}

}  // namespace teletact::client
