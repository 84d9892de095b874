// A 5 x 7 pixel font for tick labels and titles.
#pragma once

#include <array>
#include <cstdint>

namespace teletact::client {

inline constexpr int kGlyphWidth = 5, kGlyphHeight = 7, kGlyphAdvance = 6;

// Five columns, bit 0 the top row. Characters outside ' ' .. '~' are drawn as '?'.
const std::array<std::uint8_t, 5>& glyph(char character);

}  // namespace teletact::client
