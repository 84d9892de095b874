// RF from beamformed data that are complex: their phase is put back, with more samples along depth.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "client/files/uff.h"

namespace teletact::client {

struct RfImage {
  std::size_t sample_count = 0;  // of each A-line
  double sampling_frequency_hz = 0;
  std::vector<float> samples;  // axial fastest; the first lies where the image's first does
  std::string made;            // how, in one line for people; empty: they are the image's own
};

struct PulseOptions {
  double center_frequency_hz = 0, sound_speed_m_s = 0;
  std::optional<double> modulation_frequency_hz;  // of complex data, where the image does not state it
};

// Real data are taken as they are. Of complex data d at depth z the RF is the real part of
// d exp(2 pi i f t), t = 2 z / sound speed, f the modulation frequency: a whole number of samples for each of
// d's, at least 5 in a period of the centre frequency. Between d's own depths it is interpolated (a sinc
// under a Kaiser window of 32 samples, after a shift of the centre frequency to 0). Throws FrameInputError
// naming `file` and the remedy: no modulation frequency; depths too far apart for the
// pulse; echoes that lie elsewhere than at the centre frequency.
RfImage rf_of(const UffImage& image, const PulseOptions& pulse, const std::string& file);

}  // namespace teletact::client
