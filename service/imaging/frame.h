// Ultrasound RF frames and what the imaging plane makes of them, on the image grid.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace teletact::service {

// One RF frame: sample k of A-line l at samples[k + sample_count * l] (axial fastest).
struct RfFrame {
  std::size_t sample_count = 0, line_count = 0;
  std::vector<float> samples;
};

// LAB: far side rests; PROBE: probe face rests (theory, Axes): it bounds how far each depth can have moved.
enum class DisplacementFrame { kLab, kProbe };

struct AcquisitionGeometry {
  double center_frequency_hz = 0, sampling_frequency_hz = 0;
  double sound_speed_m_s = 1540;
  double line_pitch_m = 0;
  double first_sample_depth_m = 0;  // depth of sample 0
  DisplacementFrame frame = DisplacementFrame::kProbe;
  double sample_pitch_m() const { return sound_speed_m_s / (2 * sampling_frequency_hz); }
};

// Force sensor of the probe: resisting force (N, > 0 in compression) over the probe's contact area. Absent:
// the modulus is relative (T3).
struct ProbeForce {
  double force_n = 0;
  double contact_area_m2 = 0;
};

// The image grid: node (i, j) at (origin_x + i dx, origin_y + j dy), x fastest; x from the first A-line's
// left border (window coordinates), y depth.
struct ImageGrid {
  std::size_t nx = 0, ny = 0;
  double origin_x_m = 0, origin_y_m = 0, dx_m = 0, dy_m = 0;
  std::size_t size() const { return nx * ny; }
  std::size_t row(std::size_t node) const { return node / nx; }
  double x_m(std::size_t node) const { return origin_x_m + static_cast<double>(node % nx) * dx_m; }
  double y_m(std::size_t node) const { return origin_y_m + static_cast<double>(row(node)) * dy_m; }
  bool operator==(const ImageGrid&) const = default;
};

// One scalar per node of an image grid.
using Field = std::vector<float>;

// What the tissue does across the image plane: nothing (thick tissue between its neighbours), or whatever
// leaves it free of stress there (a thin slice).
enum class Plane { kStrain, kStress };

// Where the window [window_x_m, window_x_m + lines * pitch) lies in its tissue: [0, width_m] x [0, depth_m],
// y = 0 at the probe face, bonded below, free sides (T4).
struct TissueExtent {
  // Beyond it the force's slope over nu is lost in rounding, and with it whether the modulus hangs on nu.
  static constexpr double kLargestPoissonRatio = 0.49999;
  double width_m = 0, depth_m = 0, window_x_m = 0;
  double poisson_ratio = 0.49;  // 0 <= nu <= kLargestPoissonRatio
  Plane plane = Plane::kStrain;
};

// Young's modulus (Pa) that other windows, or this one before, have told at x_m (tissue coordinates) and
// depth y_m, NaN where unknown, and the standard deviation of its logarithm, NaN where that is not known.
// What lies beyond the window's borders draws stress to itself and so shows in the window.
struct KnownModulus {
  std::function<double(double x_m, double y_m)> modulus_pa = {}, log_deviation = {};
  double operator()(double x_m, double y_m) const { return modulus_pa(x_m, y_m); }
  explicit operator bool() const { return static_cast<bool>(modulus_pa); }
};

}  // namespace teletact::service
