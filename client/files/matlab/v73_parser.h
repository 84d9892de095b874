// MATLAB v7.3, which is HDF5: as MATLAB, hdf5storage and h5py write it. matio wants MATLAB's way alone.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "client/files/matfile.h"

namespace teletact::client {

bool is_hdf5(const std::filesystem::path& path);

// As parse_mat(), of a file that is HDF5, and without its lock.
MatFrames parse_v73(const std::filesystem::path& path, std::size_t file_bytes, const std::string& variable,
                    AxialAxis axial);

}  // namespace teletact::client
