// Whether what a request states about its frames agrees with the frames themselves. A wrong statement gives a
// plausible map all the same, so it must be said.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "service/base/warning.h"
#include "service/imaging/tracking/frame.h"

namespace teletact::service {

// Mean frequency of the RF, Hz, from its autocorrelation over one and two samples, which white noise does not
// enter: r2 / r1 = cos 2w / cos w, w = 2 pi f / fs. NaN without signal.
double mean_frequency(const RfFrame&, double sampling_frequency_hz);

// kImage or kAxis, when the samples do not oscillate along depth, or do so across the lines.
std::optional<Warning> contradicted_rf(const RfFrame& pre);

// When the centre frequency is not within 2/3 to 3/2 of the mean frequency.
std::optional<Warning> contradicted_frequency(const RfFrame& pre, const AcquisitionGeometry&);

// When the side that rests in the stated frame moves more than the other. Of a pair that was
// tracked; `axial_displacement` and `trusted` on the grid.
std::optional<Warning> contradicted_frame(const AcquisitionGeometry&, const ImageGrid&,
                                          const Field& axial_displacement,
                                          const std::vector<std::uint8_t>& trusted);

}  // namespace teletact::service
