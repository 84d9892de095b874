#include "client/files/picture.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <iterator>
#include <stdexcept>

namespace teletact::client {
namespace {

constexpr std::size_t kLargestSide = 20000;  // pixels

struct Range {
  double low, high;
};

Range range_of(const Panel& panel) {
  std::vector<float> finite;
  std::ranges::copy_if(panel.values, std::back_inserter(finite), [](float v) { return std::isfinite(v); });
  if (finite.empty()) return {0, 1};
  const auto quantile = [&](double q) {
    const auto at = finite.begin() + std::lround(q * static_cast<double>(finite.size() - 1));
    std::nth_element(finite.begin(), at, finite.end());
    return static_cast<double>(*at);
  };
  Range r{std::isfinite(panel.low) ? panel.low : quantile(.01),
          std::isfinite(panel.high) ? panel.high : quantile(.99)};
  if (!(r.high > r.low)) r.high = r.low + std::max(1e-12, std::abs(r.low) * 1e-3);
  return r;
}

double map_height(const Panel& panel, std::size_t width) {
  return static_cast<double>(width) * static_cast<double>(panel.ny) * panel.dy_m /
         (static_cast<double>(panel.nx) * panel.dx_m);
}

void check(const Panel& panel, const PictureOptions& options) {
  const auto fail = [&](const char* what) {
    throw std::invalid_argument("panel '" + panel.title + "': " + what);
  };
  if (panel.nx == 0 || panel.ny == 0 || panel.values.size() != panel.nx * panel.ny)
    fail("values must hold nx x ny numbers");
  if (!(panel.dx_m > 0) || !(panel.dy_m > 0)) fail("dx_m and dy_m must be positive");
  if (!std::isfinite(panel.factor) || panel.factor == 0) fail("factor must be finite and not zero");
  if (!(map_height(panel, options.panel_width) < static_cast<double>(kLargestSide)))
    fail("is too tall to be drawn; check dx_m and dy_m");
}

// Numbers along one axis (mm): first, spacing, and the borders of the map.
struct Axis {
  double first, spacing, begin, end;
};

Axis axis_of(double origin_m, double spacing_m, std::size_t count, std::size_t repeated) {
  const double begin = 1e3 * (origin_m - spacing_m / 2), step = 1e3 * spacing_m / double(repeated);
  return {begin + step / 2, step, begin, begin + 1e3 * spacing_m * double(count)};
}

// Axes, colours, and the values behind their command, in binary.
std::string script_of(const Panel& panel) {
  // An image has two points along each axis at least.
  const std::size_t along_x = panel.nx == 1 ? 2 : 1, along_y = panel.ny == 1 ? 2 : 1;
  const Axis x = axis_of(panel.origin_x_m, panel.dx_m, panel.nx, along_x),
             y = axis_of(panel.origin_y_m, panel.dy_m, panel.ny, along_y);
  const Range range = range_of(panel);
  // The colours of "viridis" (matplotlib, CC0), evenly perceived and readable in grey, on grey.
  constexpr const char* kColours =
      "defined (0 '#440154', 1 '#482475', 2 '#414487', 3 '#355f8d', 4 '#2a788e', 5 '#21918c', 6 '#22a884', "
      "7 '#44bf70', 8 '#7ad151', 9 '#bddf26', 10 '#fde725')";
  std::string script = fmt::format(
      "set palette {}\nset title {} noenhanced\nset ylabel {} noenhanced\nset cblabel {} noenhanced\nset "
      "cbrange [{}:{}]\n"
      "set xrange [{}:{}]\nset yrange [{}:{}]\n"
      "plot '-' binary array=({},{}) format='%float32' dx={} dy={} origin=({},{}) with image\n",
      panel.grey ? "gray" : kColours, gnuplot_string(panel.title), gnuplot_string(panel.down + " (mm)"),
      gnuplot_string(panel.unit), range.low * panel.factor, range.high * panel.factor, x.begin, x.end, y.end,
      y.begin, along_x * panel.nx, along_y * panel.ny, x.spacing, y.spacing, x.first, y.first);
  for (std::size_t j = 0; j < along_y * panel.ny; ++j)
    for (std::size_t i = 0; i < along_x * panel.nx; ++i) {
      const float shown = panel.values[i / along_x + panel.nx * (j / along_y)] * float(panel.factor);
      const float value = std::isfinite(shown) ? shown : std::numeric_limits<float>::quiet_NaN();
      script.append(reinterpret_cast<const char*>(&value), sizeof value);
    }
  return script + "\n";
}

}  // namespace

std::string gnuplot_string(const std::string& text) {
  std::string out = "'";
  for (const char c : text)
    out += c == '\'' ? "\u2019" : std::string(1, static_cast<unsigned char>(c) < ' ' ? ' ' : c);
  return out + "'";
}

void plot(const std::filesystem::path& path, std::size_t width, std::size_t height,
          const std::string& script) {
  const std::string drawn = path.string() + ".partial" + std::to_string(::getpid()),
                    commands = drawn + ".gnuplot";
  write_file(commands,
             fmt::format("set terminal pngcairo size {},{} font 'sans,11'\n{}", width, height, script));
  const char* const arguments[]{"gnuplot", "-d", commands.c_str(), nullptr};  // -d: as nobody has set it up
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, drawn.c_str(), O_WRONLY | O_CREAT | O_TRUNC,
                                     0666);
  pid_t process = 0;
  const int missing =
      ::posix_spawnp(&process, arguments[0], &actions, nullptr, const_cast<char* const*>(arguments), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  int status = 0;
  while (missing == 0 && ::waitpid(process, &status, 0) < 0 && errno == EINTR) {
  }
  std::error_code error, ignored;
  if (missing == 0 && status == 0) std::filesystem::rename(drawn, path, error);
  std::filesystem::remove(commands, ignored);
  std::filesystem::remove(drawn, ignored);
  if (missing != 0) throw FileError(path, "gnuplot could not be started; install gnuplot-nox");
  if (status != 0 || error) throw FileError(path, "gnuplot failed; is the disk full?");
}

void write_png(const std::filesystem::path& path, std::span<const Panel> panels,
               const PictureOptions& options) {
  constexpr std::size_t kBeside = 160, kAbove = 120;  // pixels around a map: numbers, title, colour bar
  if (panels.empty()) throw std::invalid_argument("panels: give at least one");
  if (options.panel_width < 16 || options.panel_width > kLargestSide)
    throw std::invalid_argument("panel_width must be 16 to 20000 pixels");
  const std::size_t columns = options.columns == 0 ? panels.size() : std::min(options.columns, panels.size()),
                    rows = (panels.size() + columns - 1) / columns;
  double height = 8;  // all rows as high as the tallest map
  for (const Panel& panel : panels) {
    check(panel, options);
    height = std::max(height, map_height(panel, options.panel_width));
  }
  std::string script = fmt::format(
      "set object 1 rectangle from graph 0,0 to graph 1,1 behind fc rgb '#808080' fs solid noborder\n"
      "unset key\nset size ratio -1\nset xlabel 'x (mm)'\nset tics out nomirror font ',9'\n"
      "set multiplot layout {},{}\n",
      rows, columns);
  for (const Panel& panel : panels) script += script_of(panel);
  plot(path, columns * (options.panel_width + kBeside), rows * (std::size_t(height) + kAbove), script);
}

}  // namespace teletact::client
