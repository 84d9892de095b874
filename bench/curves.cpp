#include "bench/curves.h"

#include <fmt/format.h>

#include <cmath>

namespace teletact::bench {

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
    command += fmt::format("{}$c{} with {} lw {} pt {} ps 1.2 title '{}'", c > 0 ? ", " : "", c,
                           intervals    ? "yerrorlines"
                           : curve.line ? "linespoints"
                                        : "points",
                           curve.ours ? 3 : 1, c + 4, curve.title);
  }
  return data + settings + command + "\n";
}

}  // namespace teletact::bench
