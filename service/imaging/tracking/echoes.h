// Where a frame holds echoes: looked for before anything is tracked, so that a beamformer's silent rows, hum
// and dead lines count as what lies outside of the frame.
#pragma once

#include <vector>

#include "service/imaging/tracking/frame.h"
#include "service/imaging/tracking/sample_grid.h"

namespace teletact::service {

struct Echoes {
  std::vector<EchoSpan> lines;  // of each A-line; [0, 0) of a silent line
  // Mean power about the echoes' own frequency of `step` samples, index row + rows * line.
  int rows = 0, step = 1;
  std::vector<float> power;
};

// Silence begins where the power falls to a tenth at once and stays there up to the frame's end (of lines: up
// to where it rises again): speckle averaged over a kernel does so less than once in a million.
Echoes find_echoes(const RfFrame&, const AcquisitionGeometry&);

// First sample below what may be coupling: down to a line across the upper half of the frame, ten times as
// bright as what is above and below, nothing is heard, or the same in both frames; 0: nothing looks like it.
// The echoes are those of `pre`.
int coupling_end(const RfFrame& pre, const RfFrame& post, const Echoes&);

// The first sample of what stays the same up to the frames' end, to a twentieth of its power, below what
// moves: hum that is locked to the transmission. Tissue that comes to rest does so gradually. `step`: that of
// Echoes.
int still_from(const RfFrame& pre, const RfFrame& post, int step);

// The spans of `lines` less so many samples and lines beside what is silent.
std::vector<EchoSpan> away_from_silence(const std::vector<EchoSpan>& lines, int samples, int half_lines,
                                        int half_samples);

}  // namespace teletact::service
