// Text of a client or a file as messages and logs may show it.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace teletact::service {

// Printable, without quotes, at most so many bytes. (gRPC drops a status whose message is longer than a few
// KB; a line of the log must stay one line.)
inline std::string shown(std::string_view text, std::size_t max_bytes = 64) {
  std::string out(text.substr(0, max_bytes));
  for (char& c : out)
    if (c < ' ' || c > '~' || c == '"') c = '?';
  return text.size() > max_bytes ? out + "..." : out;
}

}  // namespace teletact::service
