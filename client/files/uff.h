// Files of the UltraSound ToolBox (USTB), Ultrasound File Format: HDF5 with an object of the class
// uff.beamformed_data. Source: USTB's uff.write_object, uff.beamformed_data and uff.linear_scan.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/files/file_io.h"

namespace teletact::client {

// One frame, axial fastest: sample k of line l at values[k + sample_count * l]. Line l lies line_pitch_m * l
// beside the first, sample k at first_sample_depth_m + sample_pitch_m * k.
struct UffImage {
  std::size_t sample_count = 0, line_count = 0;
  std::size_t frame_count = 1;  // that the file holds
  double first_sample_depth_m = 0, sample_pitch_m = 0, line_pitch_m = 0;
  std::vector<float> values;     // of complex data the real part
  std::vector<float> imaginary;  // as many; empty: the data are real
  // What the phase of complex data lacks: exp(2 pi i f 2 depth / sound speed). 0: nothing, they are the
  // analytic signal.
  std::optional<double> modulation_frequency_hz;
  std::optional<double> sound_speed_m_s;  // with which the first transmit was beamformed
};

// Reads frame `frame` (of 0 .. frame_count - 1; beyond: the last) of the object `object`, a path within the
// file; "": the only one there is. A process of its own, with limits, parses it (matlab/parser_process.h).
// Throws FileError naming the file and the remedy: not HDF5, damaged, no such object (lists those that are
// there), channel data, another scan than a linear one, several channels or transmits, fields that are
// missing, contradict each other or are not finite; one that crashes its parser, or takes it too much memory
// or time.
UffImage read_uff(const std::filesystem::path& path, const std::string& object, std::size_t frame);

}  // namespace teletact::client
