// Whether what a request states about its frames agrees with the frames themselves. A wrong statement gives a
// plausible map all the same, so it must be said.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "service/imaging/frame.h"

namespace teletact::service {

// Mean frequency of the RF, Hz, from its autocorrelation over one sample (Kasai et al. 1985, for real
// signals: r1 / r0 = cos(2 pi f / fs)); NaN without signal. White noise pulls it towards fs / 4.
double mean_frequency(const RfFrame&, double sampling_frequency_hz);

// One line for each statement that the frames contradict, the field named first: a centre frequency that is
// not within 2/3 to 3/2 of the mean frequency; a displacement frame whose side at rest moves more than the
// other. `axial_displacement` and `trusted` on the grid (nx, ny, x fastest).
std::vector<std::string> contradictions(const RfFrame& pre, const AcquisitionGeometry&, const ImageGrid&,
                                        const Field& axial_displacement,
                                        const std::vector<std::uint8_t>& trusted);

}  // namespace teletact::service
