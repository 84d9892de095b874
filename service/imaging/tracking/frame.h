// Ultrasound RF frames, the image grid that everything found from them lies on, and their B-mode image.
#pragma once

#include <cstddef>
#include <cstdint>
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
  bool operator==(const AcquisitionGeometry&) const = default;
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

// B-mode image (T2.9). Grey value g of node (i, j) at i + nx j: 60 (g / 255 - 1) dB of the image's largest
// envelope, 0 at -60 dB and below. Nodes along x are the A-lines; a row stands for the mean power of so many
// samples that there are at most 512 rows.
struct BMode {
  static constexpr double kRangeDb = 60;
  static constexpr std::size_t kMaxRows = 512;
  ImageGrid grid;
  std::vector<std::uint8_t> grey;
};

}  // namespace teletact::service
