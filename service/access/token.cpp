#include "service/access/token.h"

#include <openssl/evp.h>
#include <openssl/rand.h>

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

std::string hex_of(const Digest& digest) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string out;
  for (const unsigned char byte : digest) {
    out += kDigits[byte >> 4];
    out += kDigits[byte & 15];
  }
  return out;
}

std::string make_token() {
  Digest random;
  if (RAND_priv_bytes(random.data(), random.size()) != 1)
    throw std::runtime_error("the system has no random numbers for a token");
  return hex_of(random);
}

}  // namespace teletact::service
