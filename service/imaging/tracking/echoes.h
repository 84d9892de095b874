// Where a pair of frames holds echoes: looked for before anything is tracked, so that a beamformer's silent
// rows, hum and dead lines count as what lies outside of the frame.
#pragma once

#include <cstdint>
#include <vector>

#include "service/imaging/tracking/frame.h"
#include "service/imaging/tracking/sample_grid.h"

namespace teletact::service {

struct Echoes {
  std::vector<EchoSpan> lines;  // of each A-line, in both frames; [0, 0) of a silent line
  // Mean power about the echoes' own frequency of `step` samples, index row + rows * line: of the quieter
  // frame.
  int rows = 0, step = 1;
  std::vector<float> power;
};

// Silence begins where the power falls to a tenth at once and stays there up to the frame's end (of lines: up
// to where it rises again): speckle averaged over a kernel does so less than once in a million.
Echoes find_echoes(const RfFrame& pre, const RfFrame& post, const AcquisitionGeometry&);

// Rows of `power` in the upper half of the frame where most lines are ten times as bright as above and below.
std::vector<int> bright_rows(const Echoes&);

// 1: so many lines and samples to each side of the node hold echoes, or lie outside of the frame.
std::vector<std::uint8_t> nodes_in_echoes(const Echoes&, const SampleGrid&, int samples, int half_lines,
                                          int half_samples);

}  // namespace teletact::service
