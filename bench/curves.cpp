#include "bench/curves.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdio>

#include "bench/suite.h"

namespace teletact::bench {

namespace {

// Told apart on white; more curves than these differ in their marks.
constexpr std::array<const char*, 16> kColours{
    "#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#8c564b", "#e377c2", "#17becf",
    "#000000", "#bcbd22", "#7f7f7f", "#00308f", "#7b1113", "#006400", "#daa520", "#ff00ff"};

}  // namespace

std::string axes(const std::string& title, const std::string& x, const std::string& y) {
  return "set title \"" + title + "\"\nset xlabel '" + x + "'\nset ylabel '" + y + "'\n";
}

std::string script_of(const std::vector<Curve>& curves, const std::string& settings,
                      const std::string& more) {
  std::string data, command;
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
    const std::string style =
        !curve.style.empty() ? curve.style
                             : fmt::format("{} lw {} pt {} ps 1.2 lc rgb '{}'",
                                           intervals    ? "yerrorlines"
                                           : curve.line ? "linespoints"
                                                        : "points",
                                           curve.ours ? 3 : 1, look + 4, kColours[look % kColours.size()]);
    command += fmt::format("{}$c{} with {} title '{}'", c > 0 ? ", " : "", c, style, curve.title);
  }
  return data + settings + "plot " + command + more + "\n";
}

void plot(const std::filesystem::path& file, const std::string& script) {
  const std::string whole = "set terminal pngcairo size 900,600 font 'sans,11'\nset output '" +
                            file.string() + "'\nset grid lc rgb '#dddddd'\n" + script;
  FILE* pipe = popen("gnuplot", "w");
  if (pipe == nullptr) throw BenchError("gnuplot could not be started; install gnuplot-nox");
  const bool written = std::fwrite(whole.data(), 1, whole.size(), pipe) == whole.size();
  if (pclose(pipe) != 0 || !written)
    throw BenchError(file.string() + ": gnuplot failed; is gnuplot-nox installed?");
}

}  // namespace teletact::bench
