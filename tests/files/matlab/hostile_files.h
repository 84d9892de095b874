// Files that crash matio or HDF5, or make them claim gigabytes.
#pragma once

#include <filesystem>

#include "tests/support/environment.h"

namespace teletact::client {

inline std::filesystem::path hostile_files() {
  return std::filesystem::path(test::required_environment("TELETACT_SOURCE_DIR")) /
         "tests/files/matlab/hostile";
}

}  // namespace teletact::client
