// The file of --access, TOML: an array of tables [[entry]], each with a name, token_sha256 and/or
// certificate, roles, and optionally expires.
#pragma once

#include <cstddef>
#include <filesystem>

#include "service/access/access_table.h"

namespace teletact::service {

inline constexpr std::size_t kMaxAccessBytes = std::size_t{4} << 20;  // some 10,000 entries

// Throws std::runtime_error, one line: file, entry, key and remedy.
AccessTable read_access(const std::filesystem::path& file);

}  // namespace teletact::service
