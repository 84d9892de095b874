// NetCDF-4, which is HDF5 with named dimensions: variables on evenly spaced axes, with their units.
// Source: NetCDF Users' Guide, "NetCDF-4 Format"; names and types as xarray writes them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "client/files/file_io.h"

namespace teletact::client {

// A dimension and its coordinates (m): first_m + step_m * k.
struct NetcdfAxis {
  std::string name;
  double first_m = 0, step_m = 1;
  std::size_t count = 1;
};

// 0 or 1; xarray reads it as a truth.
struct NetcdfFlag {
  std::uint8_t value;
};

struct NetcdfVariable {
  std::string name, unit;         // its long name is its name in words: "axial strain"
  std::vector<std::string> axes;  // the slowest first
  // As many as the axes have places; of floats NaN is what is missing.
  std::variant<std::vector<float>, std::vector<std::uint8_t>, std::vector<NetcdfFlag>> values;
};

using NetcdfAttribute =
    std::variant<double, std::int64_t, std::string, std::vector<double>, std::vector<std::string>>;

struct NetcdfContent {
  std::vector<NetcdfAxis> axes;
  std::vector<NetcdfVariable> variables;
  std::vector<std::pair<std::string, NetcdfAttribute>> attributes;  // of the file
};

// Writes it to `path` and returns true; a client that was built without HDF5 writes nothing and returns
// false. Throws std::invalid_argument naming the variable that does not fit its axes, FileError when it
// cannot be written. One thread at a time.
bool write_netcdf(const std::filesystem::path& path, const NetcdfContent& content);

}  // namespace teletact::client
