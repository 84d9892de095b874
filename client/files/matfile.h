// MATLAB files, v5 (also v6, v7 compressed) and v7.3 (HDF5), through matio: one real numeric variable with
// RF.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "client/files/file_io.h"

namespace teletact::client {

// Along which MATLAB dimension depth runs. The file cannot say; the caller must.
enum class AxialAxis {
  kRows,    // the first dimension is depth: rf(sample, line[, frame]), each column one A-line
  kColumns  // the second dimension is depth: rf(line, sample[, frame]), each row one A-line
};

// Frames with axial fastest: sample k of line l of frame f at samples[k + sample_count * (l + line_count *
// f)].
struct MatFrames {
  std::size_t sample_count = 0, line_count = 0, frame_count = 1;
  std::vector<float> samples;
};

// Reads `variable`: real, numeric, full, 2-D or 3-D (the third dimension counts frames). A process of its
// own, with limits, parses it (matlab/parser_process.h). Throws FileError naming the file and the remedy: not
// a MATLAB file, damaged, no such variable (lists those that are there), complex, sparse, not numeric, larger
// than the file can hold; one that crashes its parser, or takes it too much memory or time.
MatFrames read_mat(const std::filesystem::path& path, const std::string& variable, AxialAxis axial);

}  // namespace teletact::client
