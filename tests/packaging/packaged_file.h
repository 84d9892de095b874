// Files of packaging/, as users get them.
#pragma once

#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

#include "tests/support/environment.h"

namespace teletact::test {

inline std::string packaged_path(const std::string& name) {
  return required_environment("TELETACT_SOURCE_DIR") + "/packaging/" + name;
}

inline std::string packaged_file(const std::string& name) {
  std::ifstream file(packaged_path(name));
  std::string text{std::istreambuf_iterator<char>(file), {}};
  if (text.empty()) throw std::runtime_error(packaged_path(name) + " cannot be read");
  return text;
}

inline void replace_all(std::string& text, const std::string& from, const std::string& to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
}

}  // namespace teletact::test
