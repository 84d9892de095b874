// Whether a pair of frames could be tracked, and how well.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "service/imaging/tracking/frame.h"

namespace teletact::service {

// The pair cannot be tracked; what() says why and what to do.
struct TrackingError : std::runtime_error {
  enum class Reason { kNoSignal, kDecorrelated, kBeyondSearch, kNoCompression };
  TrackingError(Reason why, const std::string& what) : std::runtime_error(what), reason(why) {}
  Reason reason;
};

// Of the nodes with texture (correlation as DisplacementEstimate has it). Throws TrackingError kNoSignal when
// fewer than a tenth of the nodes have any.
double median_correlation(const Field& correlation);

// Quality of a pair, 0 to 1: the part of the nodes whose strain can be used, times 1 / (1 + (s / e)^2) with
// the medians over them of the strain's standard deviation s and magnitude e. 1: all tracked, strain far
// above its noise; one half: strain as large as its noise, or half of the nodes lost. 0 without any usable
// node.
double pair_quality(const Field& axial_strain, const Field& axial_strain_std,
                    const std::vector<std::uint8_t>& strain_valid);

}  // namespace teletact::service
