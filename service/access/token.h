// Tokens: secrets by which a client shows who it is. The service keeps their SHA-256 alone.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string_view>

namespace teletact::service {

using Digest = std::array<unsigned char, 32>;  // SHA-256

// Throws std::runtime_error where the cryptographic library fails.
Digest digest_of(std::string_view token);
// 64 hexadecimal digits, of either case; else none.
std::optional<Digest> digest_from(std::string_view hex);

}  // namespace teletact::service
