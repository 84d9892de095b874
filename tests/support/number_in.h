// How much a test does, where the environment says so.
#pragma once

#include <cstdint>
#include <cstdlib>

namespace teletact::test {

inline std::uint64_t number_in(const char* variable, std::uint64_t otherwise) {
  const char* given = std::getenv(variable);
  return given ? std::strtoull(given, nullptr, 10) : otherwise;
}

}  // namespace teletact::test
