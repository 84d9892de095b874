// A peer's text as messages and logs may show it.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace teletact::service {

// Printable, without quotes, at most 64 bytes. (gRPC drops a status whose message is longer than a few KB; a
// line of the log must stay one line.)
inline std::string shown(std::string_view text) {
  constexpr std::size_t kMost = 64;
  std::string out(text.substr(0, kMost));
  for (char& c : out)
    if (c < ' ' || c > '~' || c == '"') c = '?';
  return text.size() > kMost ? out + "..." : out;
}

}  // namespace teletact::service
