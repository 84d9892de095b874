// What ctest tells the tests: where the sources and the build are.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>

namespace teletact::test {

inline std::string required_environment(const char* name) {
  const char* value = std::getenv(name);
  if (value == nullptr) throw std::runtime_error(std::string(name) + " is not set; run the tests with ctest");
  return value;
}

inline std::filesystem::path source_kernels() {
  return std::filesystem::path(required_environment("TELETACT_SOURCE_DIR")) / "kernels";
}

}  // namespace teletact::test
