// ParaView ImageData (.vti): named point arrays on one regular grid, XML with base64 binary data.
// Format: VTK file formats, XML ImageData, version 1.0, header_type UInt64, little-endian, uncompressed.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <variant>
#include <vector>

#include "client/files/file_io.h"

namespace teletact::client {

// Grid points: (i, j, k) at origin + (i, j, k) * spacing, i fastest. 2-D images have size[2] = 1.
struct VtiGrid {
  std::array<std::size_t, 3> size{1, 1, 1};
  std::array<double, 3> origin_m{};
  std::array<double, 3> spacing_m{1, 1, 1};
  std::size_t points() const { return size[0] * size[1] * size[2]; }
};

struct VtiArray {
  std::string name;
  std::variant<std::vector<float>, std::vector<std::uint8_t>>
      values;  // points() * components, component fastest
  std::size_t components = 1;
};

// Throws std::invalid_argument naming the array whose length does not fit, FileError when it cannot be
// written.
void write_vti(const std::filesystem::path& path, const VtiGrid& grid, const std::vector<VtiArray>& arrays);

}  // namespace teletact::client
