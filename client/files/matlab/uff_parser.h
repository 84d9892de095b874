// What reads a file of USTB in this process, by HDF5. A hostile file may crash it, or take memory and time
// without end: read_uff() has a process of its own do it.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "client/files/uff.h"

namespace teletact::client {

// As read_uff(). Follows no link to another file, and reads no data that lie in one.
UffImage parse_uff(const std::filesystem::path& path, const std::string& object, std::size_t frame);

}  // namespace teletact::client
