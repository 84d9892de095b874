// How much tissue changes between a solid's slices where neither shows it (T8.7).
#pragma once

#include <optional>
#include <vector>

#include "service/scene/felt_elements.h"
#include "service/scene/scene_record.h"

namespace teletact::service {

// Variance of ln E in the middle of each gap between neighbouring slices, beyond what a change from the one
// to the other explains: rows of elements, gap by gap. It is that of as wide gaps within the slices, with
// what is unknown as if it had been seen in one place, times how much more ln E changes from slice to slice
// than within them. Empty where no slice has a neighbour.
std::vector<double> hidden_log_variance(const ExplicitModulus&);

// Variance of what these elements feel of ln E, across the image planes as in them, beyond what is
// interpolated between slices: were one more there, too, half of what lies around it showed.
double felt_between_variance(const ExplicitModulus&, const FeltElements&,
                             std::optional<double> one_more_m = {});

}  // namespace teletact::service
