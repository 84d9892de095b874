// RF simulation (T2.7): point scatterers moved by the FE displacement (evaluated at each scatterer; no image
// is warped), convolved with a separable point-spread function: axially a cosine of the centre frequency
// under a Gaussian whose spectrum has the stated -6 dB bandwidth, laterally a Gaussian of FWHM wavelength x
// f_number, wider out of focus. With an elevational beam scatterers lie across the image plane too, and move
// there. Attenuation lowers the pulse's centre frequency with depth. Then, per pass: speckle decorrelation
// (post = rho moved + sqrt(1 - rho^2) independent speckle of the PSF at the focus and face) and white noise
// limited to center_frequency (1 -+ bandwidth), snr_db below the speckle in RMS over the frame.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "client/patient/patient.h"

namespace teletact::client {

// Coordinates of the post frame. PROBE: the probe's face is y = 0 in both frames, so that
// post(x + u) = pre(x) with u = LAB u - motion of the probe: u_y zero at the face, negative below.
// LAB: the far side rests; the face has moved to y = compression, where the tissue's echoes now begin.
enum class RfFrame { kProbe, kLab };

// Sample k of A-line l at [k + sample_count * l] (axial fastest); depth k * sample_pitch_m, lateral position
// first_line_x_m + l * line_pitch_m in scene coordinates (first A-line = window_x + pitch / 2).
struct RfGeometry {
  std::size_t sample_count = 0, line_count = 0;
  double sample_pitch_m = 0, line_pitch_m = 0, first_line_x_m = 0;
  std::size_t values() const { return sample_count * line_count; }
};

// Without noise, speckle of unit RMS.
struct RfBase {
  RfGeometry geometry;
  Ultrasound ultrasound;
  std::vector<float> pre, post;
};

// As a scanner would deliver it.
struct RfPair {
  RfGeometry geometry;
  std::vector<std::int16_t> pre, post;
};

inline constexpr double kSpeckleCounts = 2000;    // RMS of the speckle in an RfPair
inline constexpr double kScatterersPerCell = 12;  // per (axial x lateral) FWHM of the PSF

// About .3 s for 60 x 40 mm on one core. Same arguments, same pair. Beyond the bonded bottom scatterers rest
// (the support echoes like tissue); beside the tissue there are none.
RfBase simulate_rf(const Tissue& tissue, const ProbeState& probe, RfFrame frame, std::uint64_t seed);

// A pass: fresh noise in both frames and fresh decorrelation in post; the same seed gives the same pass.
RfPair with_noise(const RfBase& base, std::uint64_t seed);

}  // namespace teletact::client
