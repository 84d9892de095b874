// What reads a MATLAB file in this process, by matio and HDF5. A hostile file may crash it, or take memory
// and time without end: read_mat() has a process of its own do it.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "client/files/matfile.h"

namespace teletact::client {

// As read_mat().
MatFrames parse_mat(const std::filesystem::path& path, const std::string& variable, AxialAxis axial);

// Whether a file of so many bytes may hold so many values of `value_bytes` each.
bool can_hold(std::size_t file_bytes, long double values, std::size_t value_bytes);

}  // namespace teletact::client
