// B-mode of an RF frame in double precision and plain sums: what kernels/b_mode.cl is held against, and what
// that is held against in turn: the envelope of an analytic signal, by a Fourier transform of the whole line.
#pragma once

#include <cstdint>
#include <vector>

namespace teletact::reference {

// sample k of A-line l at rf[k + samples * l]; grey value of row r, line l at l + lines * r, 60 dB.
std::vector<std::uint8_t> b_mode(const std::vector<double>& rf, int samples, int lines, double period_samples,
                                 int tap_step, int rows_step);

// |analytic signal| of one line, periodic.
std::vector<double> hilbert_envelope(const std::vector<double>& line);

}  // namespace teletact::reference
