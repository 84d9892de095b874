// What a picture's file shows.
#pragma once

#include <gtest/gtest.h>
#include <png.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>

#include "client/files/png.h"

namespace teletact::client {

inline Picture read_png(const std::filesystem::path& path) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_file(&image, path.c_str()), 0) << image.message;
  image.format = PNG_FORMAT_RGB;
  Picture p{image.width, image.height, std::vector<std::uint8_t>(PNG_IMAGE_SIZE(image))};
  EXPECT_NE(png_image_finish_read(&image, nullptr, p.rgb.data(), 0, nullptr), 0);
  return p;
}

inline std::size_t count_of(const Picture& p, const std::array<std::uint8_t, 3>& colour) {
  std::size_t n = 0;
  for (std::size_t i = 0; i < p.rgb.size(); i += 3)
    n += std::equal(colour.begin(), colour.end(), p.rgb.begin() + static_cast<std::ptrdiff_t>(i));
  return n;
}

}  // namespace teletact::client
