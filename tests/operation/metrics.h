// Prometheus's text format, read strictly.
#pragma once

#include <map>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <string>

namespace teletact::test {

// "name{label="value"}" -> value. Throws std::runtime_error for a line that is none of the format.
inline std::map<std::string, double> metrics_of(const std::string& text) {
  static const std::regex kComment(R"(# (HELP|TYPE) [a-z_]+ .+)");
  static const std::regex kLabels(R"re(([a-z_]+(?:\{(?:[a-z_]+="[^"\\]*",?)+\})?) (-?[0-9.e+-]+))re");
  std::map<std::string, double> out;
  std::istringstream lines(text);
  std::smatch match;
  for (std::string line; std::getline(lines, line);) {
    if (std::regex_match(line, kComment)) continue;
    if (!std::regex_match(line, match, kLabels)) throw std::runtime_error("no metric: " + line);
    if (!out.emplace(match[1], std::stod(match[2])).second) throw std::runtime_error("said twice: " + line);
  }
  return out;
}

}  // namespace teletact::test
