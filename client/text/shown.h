// Text that came from a file or a peer, as messages and logs may show it.
#pragma once

#include <string>
#include <string_view>

namespace teletact::client {

// One line, printable, of `max_bytes` at most: what else is in it would draw on the terminal or forge lines
// of a log.
inline std::string shown(std::string_view text, std::size_t max_bytes = 64) {
  constexpr unsigned char kDelete = 0x7f;
  std::string out(text.substr(0, max_bytes));
  for (char& c : out)
    if (static_cast<unsigned char>(c) < ' ' || static_cast<unsigned char>(c) == kDelete) c = '?';
  return text.size() > max_bytes ? out + "..." : out;
}

}  // namespace teletact::client
