// Whether what a request states about its frames agrees with the frames themselves. A wrong statement gives a
// plausible map all the same, so it must be said.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "service/imaging/tracking/frame.h"

namespace teletact::service {

// Mean frequency of the RF, Hz, from its autocorrelation over one and two samples, which white noise does not
// enter: r2 / r1 = cos 2w / cos w, w = 2 pi f / fs. NaN without signal.
double mean_frequency(const RfFrame&, double sampling_frequency_hz);

// One line, "image" or "axis" first, when the samples do not oscillate along depth, or do so across the
// lines.
std::optional<std::string> contradicted_rf(const RfFrame& pre);

// One line, the field named first, when the centre frequency is not within 2/3 to 3/2 of the mean frequency.
std::optional<std::string> contradicted_frequency(const RfFrame& pre, const AcquisitionGeometry&);

// The same when the side that rests in the stated frame moves more than the other. Of a pair that was
// tracked; `axial_displacement` and `trusted` on the grid.
std::optional<std::string> contradicted_frame(const AcquisitionGeometry&, const ImageGrid&,
                                              const Field& axial_displacement,
                                              const std::vector<std::uint8_t>& trusted);

}  // namespace teletact::service
