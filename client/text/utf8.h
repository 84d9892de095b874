// Whether bytes that a person or a file gave are text.
#pragma once

#include <cstddef>
#include <string_view>

namespace teletact::client {

// As RFC 3629 has it: no overlong forms, no surrogates, nothing beyond U+10FFFF.
inline bool is_utf8(std::string_view text) {
  for (std::size_t k = 0; k < text.size();) {
    const auto at = [&](std::size_t n) {
      return static_cast<unsigned char>(k + n < text.size() ? text[k + n] : 0);
    };
    const unsigned first = at(0), second = at(1);
    const std::size_t more = first < 0x80   ? 0
                             : first < 0xC2 ? 4
                             : first < 0xE0 ? 1
                             : first < 0xF0 ? 2
                             : first < 0xF5 ? 3
                                            : 4;
    if (more > 3) return false;
    for (std::size_t n = 1; n <= more; ++n)
      if ((at(n) & 0xC0U) != 0x80U) return false;
    if ((first == 0xE0 && second < 0xA0) || (first == 0xED && second > 0x9F) ||
        (first == 0xF0 && second < 0x90) || (first == 0xF4 && second > 0x8F))
      return false;
    k += more + 1;
  }
  return true;
}

}  // namespace teletact::client
