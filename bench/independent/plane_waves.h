// RF of plane waves of a linear array, by the equations of SIMUS (Garcia, Computer Methods and Programs in
// Biomedicine 218, 2022: 106726), written apart from client/patient: for each frequency, each element and
// each scatterer, the far field of the element (sinc), a soft baffle's obliquity (cosine), cylindrical
// spreading, attenuation and phase. Scatterers lie in the image plane. Delay and sum, compounded over the
// angles.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace teletact::bench {

struct PlaneWaves {
  std::size_t elements = 128, samples = 1870;  // of an RF line, of which each element has one
  double pitch_m = .0003, element_m = .00027;
  double center_frequency_hz = 7.6e6, bandwidth = .75;  // -6 dB, over the centre
  double sampling_frequency_hz = 40e6;
  std::vector<double> angles_rad{-.1047, 0, .1047};
  double f_number = 1.5;             // of what receives
  double stated_speed_m_s = 1540;    // of sound, for beamforming
  double speed_m_s = 1540;           // in the tissue
  double attenuation_db_cm_mhz = 0;  // one way; the centre frequency's is made good by gain over depth
  double aberration_s = 0;           // RMS of the elements' delays, correlated over 3 mm
  double scatterers_per_cell = 4;    // of .15 x .3 mm
  double sample_pitch_m() const { return stated_speed_m_s / (2 * sampling_frequency_hz); }
  double x_m(std::size_t element) const;  // 0: the array's middle
};

struct Scatterer {
  double x_m = 0, y_m = 0, strength = 1;
};

// Of the array's RF lines: sample k of line l at [k + samples * l]; depth k * sample_pitch_m(), line l at
// x_m(l). `aberration_s`: of each element.
std::vector<float> beamformed_rf(const PlaneWaves&, std::span<const Scatterer>,
                                 std::span<const double> aberration_s);

struct PlaneWavePair {
  std::vector<std::int16_t> pre, post;
};
// Before and after scatterers at (x, y) have moved by the displacement, m. Same seed, same pair.
using Motion = std::function<Eigen::Vector2d(double x_m, double y_m)>;
PlaneWavePair plane_wave_pair(const PlaneWaves&, const Motion&, std::uint64_t seed);

}  // namespace teletact::bench
