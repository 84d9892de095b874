// Pictures by gnuplot, the same look in every suite.
#pragma once

#include <filesystem>
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
  std::string style{};                // gnuplot's own instead: "steps lw 2"
  void add(double at, double value) { x.push_back(at), y.push_back(value); }
};

// Settings of gnuplot: title and axes.
std::string axes(const std::string& title, const std::string& x, const std::string& y);

// Data blocks, `settings` and one plot command, to which `more` plots may be added.
std::string script_of(const std::vector<Curve>& curves, const std::string& settings,
                      const std::string& more = "");

// Runs gnuplot on `script`, writing `file`. Throws BenchError.
void plot(const std::filesystem::path& file, const std::string& script);

}  // namespace teletact::bench
