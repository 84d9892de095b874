// What matio does not check of a v5 file (also v6, v7): that its variables are as long as they claim. Source:
// MAT-File Format, MathWorks, chapter 1.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace teletact::client {

// Throws FileError for a v5 file that does not end with its last element, or whose numbers of this variable
// are fewer or more than its dimensions say. Does nothing for what is no v5 file.
void require_whole_v5(const std::filesystem::path& path, std::size_t file_bytes, const std::string& variable);

}  // namespace teletact::client
