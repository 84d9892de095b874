#include "service/access/token.h"

#include <openssl/evp.h>

#include <charconv>
#include <stdexcept>

namespace teletact::service {

Digest digest_of(std::string_view token) {
  Digest out;
  unsigned size = 0;
  if (EVP_Digest(token.data(), token.size(), out.data(), &size, EVP_sha256(), nullptr) != 1 ||
      size != out.size())
    throw std::runtime_error("SHA-256 cannot be computed");
  return out;
}

std::optional<Digest> digest_from(std::string_view hex) {
  Digest out;
  if (hex.size() != 2 * out.size()) return std::nullopt;
  for (std::size_t k = 0; k < out.size(); ++k) {
    const char* const begin = hex.data() + 2 * k;
    const auto read = std::from_chars(begin, begin + 2, out[k], 16);
    if (read.ec != std::errc() || read.ptr != begin + 2) return std::nullopt;
  }
  return out;
}

}  // namespace teletact::service
