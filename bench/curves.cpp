#include "bench/curves.h"

#include <fmt/format.h>

#include <array>
#include <cmath>

namespace teletact::bench {

namespace {

// Told apart on white; more curves than these differ in their marks.
constexpr std::array<const char*, 16> kColours{
    "#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#8c564b", "#e377c2", "#17becf",
    "#000000", "#bcbd22", "#7f7f7f", "#00308f", "#7b1113", "#006400", "#daa520", "#ff00ff"};

}  // namespace

std::string script_of(const std::vector<Curve>& curves, const std::string& settings) {
  std::string data, command = "plot ";
  for (std::size_t c = 0; c < curves.size(); ++c) {
    const Curve& curve = curves[c];
    const bool intervals = !curve.half_width.empty();
    data += fmt::format("$c{} << EOD\n", c);
    for (std::size_t k = 0; k < curve.x.size(); ++k) {
      data += fmt::format("{:.8g} {:.8g}", curve.x[k], curve.y[k]);
      if (intervals)
        data += fmt::format(" {:.8g}", std::isfinite(curve.half_width[k]) ? curve.half_width[k] : 0);
      data += "\n";
    }
    data += "EOD\n";
    const std::size_t look = curve.look.value_or(c);
    command += fmt::format("{}$c{} with {} lw {} pt {} ps 1.2 lc rgb '{}' title '{}'", c > 0 ? ", " : "", c,
                           intervals    ? "yerrorlines"
                           : curve.line ? "linespoints"
                                        : "points",
                           curve.ours ? 3 : 1, look + 4, kColours[look % kColours.size()], curve.title);
  }
  return data + settings + command + "\n";
}

}  // namespace teletact::bench
