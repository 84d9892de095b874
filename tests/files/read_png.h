// What a picture's file shows.
#pragma once

#include <gtest/gtest.h>
#include <png.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace teletact::client {

// 8-bit RGB, row by row from the top.
struct Pixels {
  std::size_t width = 0, height = 0;
  std::vector<std::uint8_t> rgb;
};

inline Pixels read_png(const std::filesystem::path& path) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_file(&image, path.c_str()), 0) << image.message;
  image.format = PNG_FORMAT_RGB;
  Pixels p{image.width, image.height, std::vector<std::uint8_t>(PNG_IMAGE_SIZE(image))};
  EXPECT_NE(png_image_finish_read(&image, nullptr, p.rgb.data(), 0, nullptr), 0);
  return p;
}

struct Spot {
  std::size_t count = 0;
  double x = 0, y = 0;  // their mean place
};

inline Spot spot_of(const Pixels& p, const std::array<std::uint8_t, 3>& colour) {
  Spot spot;
  for (std::size_t i = 0; i < p.rgb.size() / 3; ++i) {
    if (!std::equal(colour.begin(), colour.end(), p.rgb.begin() + static_cast<std::ptrdiff_t>(3 * i)))
      continue;
    ++spot.count;
    spot.x += static_cast<double>(i % p.width), spot.y += static_cast<double>(i / p.width);
  }
  spot.x /= static_cast<double>(spot.count), spot.y /= static_cast<double>(spot.count);
  return spot;
}

inline std::size_t count_of(const Pixels& p, const std::array<std::uint8_t, 3>& colour) {
  return spot_of(p, colour).count;
}

}  // namespace teletact::client
