// What slices of one solid tell of the tissue that they share: how likely each kind of it is, and what is not
// known of the face, the depth and the skin (T3.9).
#pragma once

#include <vector>

#include "service/imaging/modulus/tissue_extent.h"
#include "service/imaging/modulus/weighed_tissues.h"

namespace teletact::service {

// The name of a tissue's kind.
ToldTissue named(const TissueWindow&, const CandidateTissue&);
// What the nearest slice tells of that kind; null: not where it was. This face with the lengths that it had
// there, as far as the window allows them.
const ToldTissue* nearest(const std::vector<ToldBeside>&, const ToldTissue& name);
ProbeFace begun_at(const ToldTissue&, const TissueWindow&, ProbeFace);
// ln of the odds of that kind by other slices, under a face as long as this one.
double told_odds(const std::vector<ToldBeside>&, const ProbeFace&, const ToldTissue& name);

// By this window's strain alone, whatever add_odds() has added, but for what a fit is not linear in: how far
// that is depends on where each tissue was solved, which other slices may have told.
std::vector<ToldTissue> told_by(const std::vector<WeighedTissues>&);
// Before they are weighed together: their odds by other slices.
void add_odds(const std::vector<ToldBeside>&, std::vector<WeighedTissues>&);
// After that, what each leaves open, by other slices, too, but where they contradict it. Says what is so of
// the likeliest.
enum class Heeded { kNothing, kAll, kContradicted };
Heeded sharpen(const std::vector<ToldBeside>&, std::vector<WeighedTissues>&);

// Weights of all. A kind that two starts lead to the same face and depth counts once, as the likelier says.
void weigh_together(std::vector<WeighedTissues>& starts);

// Weighs tissues together, with the skin of those that count, and by what other slices tell, unless that
// contradicts the likeliest.
struct TogetherWeighed {
  std::vector<ToldTissue> told;  // by this window alone
  Heeded heeded = Heeded::kNothing;
};
TogetherWeighed weigh_together(const TissueWeigher&, const std::vector<ToldBeside>&,
                               std::vector<WeighedTissues>&);

}  // namespace teletact::service
