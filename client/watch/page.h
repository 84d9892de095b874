// The page's files, embedded at build.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace teletact::client {

struct PageFile {
  std::string_view text;
  const char* type;
};

// None of another name.
std::optional<PageFile> page_file(const std::string& name);

}  // namespace teletact::client
