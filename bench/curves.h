// Curves of a chart for gnuplot, the same look in every suite.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace teletact::bench {

struct Curve {
  std::string title;
  bool ours = false, line = true;  // ours are drawn thicker
  std::vector<double> x{}, y{};
  std::vector<double> half_width{};   // of an interval around y; empty for none
  std::optional<std::size_t> look{};  // colour and mark, so that several pictures agree; none: by its place
};

// Data blocks, `settings` and one plot command.
std::string script_of(const std::vector<Curve>& curves, const std::string& settings);

}  // namespace teletact::bench
