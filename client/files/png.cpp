#include "client/files/png.h"

#include <png.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "client/files/font.h"

namespace teletact::client {

namespace {

using Colour = std::array<std::uint8_t, 3>;
constexpr Colour kBlack{0, 0, 0};
// Pixels around a panel's map: numbers left and below, title above, colour bar right.
constexpr int kLeft = 46, kTop = 22, kBottom = 34, kRight = 96, kBarWidth = 14, kBarGap = 12, kTick = 4;
constexpr std::size_t kLargestSide = 20000;

struct Box {
  int x, y, width, height;
};

void put(Picture& p, int x, int y, const Colour& c) {
  if (x < 0 || y < 0 || x >= static_cast<int>(p.width) || y >= static_cast<int>(p.height)) return;
  std::copy(c.begin(), c.end(),
            p.rgb.begin() + 3 * (static_cast<std::ptrdiff_t>(y) * static_cast<std::ptrdiff_t>(p.width) + x));
}

void write_text(Picture& p, int x, int y, const std::string& text) {
  for (const char character : text) {
    const auto& columns = glyph(character);
    for (int i = 0; i < kGlyphWidth; ++i)
      for (int j = 0; j < kGlyphHeight; ++j)
        if (columns[static_cast<std::size_t>(i)] >> j & 1) put(p, x + i, y + j, kBlack);
    x += kGlyphAdvance;
  }
}

int text_width(const std::string& text) {
  return static_cast<int>(text.size()) * kGlyphAdvance - 1;
}

void frame(Picture& p, const Box& b) {
  for (int x = b.x - 1; x <= b.x + b.width; ++x)
    put(p, x, b.y - 1, kBlack), put(p, x, b.y + b.height, kBlack);
  for (int y = b.y - 1; y <= b.y + b.height; ++y)
    put(p, b.x - 1, y, kBlack), put(p, b.x + b.width, y, kBlack);
}

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value == 0 ? 0.0 : value);
  return text;
}

// Round values (1, 2, 5 times a power of ten) covering [low, high] with at most about `most` of them.
std::vector<double> ticks(double low, double high, int most) {
  const double raw = (high - low) / std::max(1, most);
  const double power = std::pow(10, std::floor(std::log10(raw)));
  double step = 10 * power;
  for (const double m : {1.0, 2.0, 5.0})
    if (m * power >= raw * (1 - 1e-9)) {
      step = m * power;
      break;
    }
  std::vector<double> out;
  for (double k = std::ceil(low / step - 1e-6); k * step <= high + 1e-6 * step; ++k) out.push_back(k * step);
  return out;
}

struct Range {
  double low, high;
};

Range range_of(const Panel& panel) {
  if (std::isfinite(panel.low) && std::isfinite(panel.high) && panel.high > panel.low)
    return {panel.low, panel.high};
  std::vector<float> finite;
  std::copy_if(panel.values.begin(), panel.values.end(), std::back_inserter(finite),
               [](float v) { return std::isfinite(v); });
  if (finite.empty()) return {0, 1};
  const auto quantile = [&](double q) {
    const auto at = finite.begin() + std::lround(q * static_cast<double>(finite.size() - 1));
    std::nth_element(finite.begin(), at, finite.end());
    return static_cast<double>(*at);
  };
  Range r{quantile(.01), quantile(.99)};
  if (std::isfinite(panel.low)) r.low = panel.low;
  if (std::isfinite(panel.high)) r.high = panel.high;
  if (!(r.high > r.low)) r.high = r.low + std::max(1e-12, std::abs(r.low) * 1e-3);
  return r;
}

void draw_map(Picture& p, const Panel& panel, const Box& b, const Range& range) {
  for (int y = 0; y < b.height; ++y)
    for (int x = 0; x < b.width; ++x) {
      const auto i = static_cast<std::size_t>((x + .5) / b.width * static_cast<double>(panel.nx));
      const auto j = static_cast<std::size_t>((y + .5) / b.height * static_cast<double>(panel.ny));
      const double value = panel.values[i + panel.nx * j];
      put(p, b.x + x, b.y + y,
          std::isfinite(value) ? colour_at((value - range.low) / (range.high - range.low)) : kNanGrey);
    }
  frame(p, b);
}

void draw_axes(Picture& p, const Panel& panel, const Box& b) {
  const double left = (panel.origin_x_m - panel.dx_m / 2) * 1e3,
               width = static_cast<double>(panel.nx) * panel.dx_m * 1e3;
  const double top = (panel.origin_y_m - panel.dy_m / 2) * 1e3,
               height = static_cast<double>(panel.ny) * panel.dy_m * 1e3;
  for (const double t : ticks(left, left + width, b.width / 60)) {
    const int x = b.x + static_cast<int>(std::lround((t - left) / width * b.width));
    for (int k = 1; k <= kTick; ++k) put(p, x, b.y + b.height + k, kBlack);
    write_text(p, x - text_width(number(t)) / 2, b.y + b.height + kTick + 3, number(t));
  }
  for (const double t : ticks(top, top + height, std::max(2, b.height / 30))) {
    const int y = b.y + static_cast<int>(std::lround((t - top) / height * b.height));
    for (int k = 1; k <= kTick; ++k) put(p, b.x - 1 - k, y, kBlack);
    write_text(p, b.x - 8 - text_width(number(t)), y - kGlyphHeight / 2, number(t));
  }
  write_text(p, b.x + b.width / 2 - text_width("x (mm)") / 2, b.y + b.height + kTick + 14, "x (mm)");
  write_text(p, b.x - kLeft + 2, b.y - 14, panel.down + " (mm)");
}

void draw_bar(Picture& p, const Panel& panel, const Box& map, const Range& range) {
  const Box bar{map.x + map.width + kBarGap, map.y, kBarWidth, map.height};
  for (int y = 0; y < bar.height; ++y)
    for (int x = 0; x < bar.width; ++x) put(p, bar.x + x, bar.y + y, colour_at(1 - (y + .5) / bar.height));
  frame(p, bar);
  const double low = std::min(range.low * panel.factor, range.high * panel.factor);
  const double high = std::max(range.low * panel.factor, range.high * panel.factor);
  for (const double t : ticks(low, high, std::max(2, bar.height / 24))) {
    const double up = (t / panel.factor - range.low) / (range.high - range.low);
    const int y = bar.y + static_cast<int>(std::lround((1 - up) * bar.height));
    for (int k = 1; k <= kTick; ++k) put(p, bar.x + bar.width + k, y, kBlack);
    write_text(p, bar.x + bar.width + kTick + 3, y - kGlyphHeight / 2, number(t));
  }
  write_text(p, bar.x, bar.y - 14, panel.unit);
}

int map_height(const Panel& panel, int width) {
  const double aspect =
      static_cast<double>(panel.ny) * panel.dy_m / (static_cast<double>(panel.nx) * panel.dx_m);
  return std::max(8, static_cast<int>(std::lround(width * aspect)));
}

void check(const Panel& panel, const PictureOptions& options) {
  const auto fail = [&](const char* what) {
    throw std::invalid_argument("panel '" + panel.title + "': " + what);
  };
  if (panel.nx == 0 || panel.ny == 0 || panel.values.size() != panel.nx * panel.ny)
    fail("values must hold nx x ny numbers");
  if (!(panel.dx_m > 0) || !(panel.dy_m > 0)) fail("dx_m and dy_m must be positive");
  if (!std::isfinite(panel.factor) || panel.factor == 0) fail("factor must be finite and not zero");
  const double height = static_cast<double>(options.panel_width) * static_cast<double>(panel.ny) *
                        panel.dy_m / (static_cast<double>(panel.nx) * panel.dx_m);
  if (!(height < static_cast<double>(kLargestSide))) fail("is too tall to be drawn; check dx_m and dy_m");
}

}  // namespace

std::array<std::uint8_t, 3> colour_at(double position) {
  // The colours of "viridis" (matplotlib, CC0) at tenths, linear between.
  static constexpr std::array<Colour, 11> kStops{{{68, 1, 84},
                                                  {72, 36, 117},
                                                  {65, 68, 135},
                                                  {53, 95, 141},
                                                  {42, 120, 142},
                                                  {33, 145, 140},
                                                  {34, 168, 132},
                                                  {68, 191, 112},
                                                  {122, 209, 81},
                                                  {189, 223, 38},
                                                  {253, 231, 37}}};
  const double scaled = 10 * std::clamp(position, 0.0, 1.0);
  const auto k = std::min<std::size_t>(9, static_cast<std::size_t>(scaled));
  Colour c{};
  for (std::size_t n = 0; n < 3; ++n)
    c[n] = static_cast<std::uint8_t>(
        std::lround(kStops[k][n] + (scaled - static_cast<double>(k)) * (kStops[k + 1][n] - kStops[k][n])));
  return c;
}

Picture draw(std::span<const Panel> panels, const PictureOptions& options) {
  if (panels.empty()) throw std::invalid_argument("panels: give at least one");
  if (options.panel_width < 16 || options.panel_width > kLargestSide)
    throw std::invalid_argument("panel_width must be 16 to 20000 pixels");
  const std::size_t columns = options.columns == 0 ? panels.size() : std::min(options.columns, panels.size());
  const int width = static_cast<int>(options.panel_width);
  int height = 0;  // all rows as high as the tallest map
  for (const Panel& panel : panels) {
    check(panel, options);
    height = std::max(height, map_height(panel, width));
  }
  const std::size_t rows = (panels.size() + columns - 1) / columns;
  const int cell_width = kLeft + width + kRight, cell_height = kTop + height + kBottom;
  Picture picture{
      columns * static_cast<std::size_t>(cell_width), rows * static_cast<std::size_t>(cell_height), {}};
  picture.rgb.assign(3 * picture.width * picture.height, 255);
  for (std::size_t k = 0; k < panels.size(); ++k) {
    const Panel& panel = panels[k];
    const Box box{static_cast<int>(k % columns) * cell_width + kLeft,
                  static_cast<int>(k / columns) * cell_height + kTop, width, map_height(panel, width)};
    const Range range = range_of(panel);
    draw_map(picture, panel, box, range);
    draw_axes(picture, panel, box);
    draw_bar(picture, panel, box, range);
    write_text(picture, box.x + width / 2 - text_width(panel.title) / 2, box.y - 14, panel.title);
  }
  return picture;
}

void write_png(const std::filesystem::path& path, const Picture& picture) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(picture.width);
  image.height = static_cast<png_uint_32>(picture.height);
  image.format = PNG_FORMAT_RGB;
  png_alloc_size_t bytes = 0;
  if (!png_image_write_get_memory_size(image, bytes, 0, picture.rgb.data(), 0, nullptr))
    throw FileError(path, std::string("cannot be encoded (") + image.message + "); make the picture smaller");
  std::vector<std::byte> file(bytes);
  if (!png_image_write_to_memory(&image, file.data(), &bytes, 0, picture.rgb.data(), 0, nullptr))
    throw FileError(path, std::string("cannot be encoded (") + image.message + "); make the picture smaller");
  write_file(path, {}, std::span(file).first(bytes));
}

}  // namespace teletact::client
