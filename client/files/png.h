// Pictures of scalar maps: a perceptual colour map, axes in millimetres, a colour bar with numbers.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "client/files/file_io.h"

namespace teletact::client {

// One map: value (i, j) at values[i + nx * j], drawn as a rectangle of dx x dy centred on its point; y down.
struct Panel {
  std::string title;
  std::size_t nx = 0, ny = 0;
  double origin_x_m = 0, origin_y_m = 0;  // of point (0, 0)
  double dx_m = 1e-3, dy_m = 1e-3;
  std::string down = "y";     // the axis that goes down
  std::vector<float> values;  // NaN is drawn grey
  std::string unit;           // beside the colour bar, e.g. "kPa"
  double factor = 1;          // numbers on the bar are value * factor (Pa -> kPa: 1e-3)
  // Range of the colours; NaN = the 1st to 99th percentile of the finite values. Give both panels of a
  // comparison the same range.
  double low = std::numeric_limits<double>::quiet_NaN(), high = std::numeric_limits<double>::quiet_NaN();
};

struct PictureOptions {
  std::size_t columns = 0;        // panels beside each other before a new row begins; 0 = all in one row
  std::size_t panel_width = 480;  // pixels of each panel's map; its height follows from the spacing
};

// 8-bit RGB, row by row from the top.
struct Picture {
  std::size_t width = 0, height = 0;
  std::vector<std::uint8_t> rgb;
};

// Colour at `position` in [0, 1] (clamped): dark blue over green to yellow, evenly perceived, readable in
// grey.
std::array<std::uint8_t, 3> colour_at(double position);
inline constexpr std::array<std::uint8_t, 3> kNanGrey{128, 128, 128};

// Throws std::invalid_argument naming the panel whose sizes are unusable.
Picture draw(std::span<const Panel> panels, const PictureOptions& options = {});

// Throws FileError when the file cannot be written.
void write_png(const std::filesystem::path& path, const Picture& picture);
inline void write_png(const std::filesystem::path& path, std::span<const Panel> panels,
                      const PictureOptions& options = {}) {
  write_png(path, draw(panels, options));
}

}  // namespace teletact::client
