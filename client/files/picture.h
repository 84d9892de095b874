// Pictures by gnuplot (package gnuplot-nox): maps of scalars, and what a script of one's own draws.
#pragma once

#include <cstddef>
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
  std::vector<float> values;  // what is not finite is drawn grey
  std::string unit;           // beside the colour bar, e.g. "kPa"
  bool grey = false;          // shades instead of colours
  double factor = 1;          // numbers on the bar are value * factor (Pa -> kPa: 1e-3)
  // Range of the colours; NaN = the 1st to 99th percentile of the finite values. Give both panels of a
  // comparison the same range.
  double low = std::numeric_limits<double>::quiet_NaN(), high = std::numeric_limits<double>::quiet_NaN();
};

struct PictureOptions {
  std::size_t columns = 0;        // panels beside each other before a new row begins; 0 = all in one row
  std::size_t panel_width = 480;  // pixels of each panel's map; its height follows from the spacing
};

// The text between single quotes, as gnuplot reads it: nothing in it ends them. An apostrophe is a
// typographic one (gnuplot takes two at the beginning for an empty string), a control character a blank.
std::string gnuplot_string(const std::string& text);

// What the script draws on so many pixels. Throws FileError: gnuplot is missing or fails, or the file cannot
// be written; then there is none.
void plot(const std::filesystem::path& path, std::size_t width, std::size_t height,
          const std::string& script);

// Throws as plot(), and std::invalid_argument naming the panel whose sizes are unusable.
void write_png(const std::filesystem::path& path, std::span<const Panel> panels,
               const PictureOptions& options = {});

}  // namespace teletact::client
