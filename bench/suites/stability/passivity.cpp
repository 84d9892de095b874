// The passivity border of a held, delayed spring, by the energy of its worst imposed motion on the client's
// own hold renderer, against (T5.2). What is swept is the delay: border / (K T) depends on nothing else, and
// K and T are varied only to see that the renderer keeps to that.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "bench/stability/passivity_border.h"
#include "bench/suites/stability/stability.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

constexpr double kWithin = 0.02;  // of (T5.2)
constexpr double kSlowSamples = 100;

std::vector<double> delays(bool quick) {
  std::vector<double> all{0, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9,  1,  1.25, 1.5,
                          2, 2.3,  3.7, 5,    5.5, 10,   10.7, 20, 20.5};
  if (quick) all.resize(12);
  return all;
}

json measure(bool quick, std::vector<Target>& targets) {
  json rows = json::array();
  double worst = 0, hidden = 0, spread = 0;
  std::printf("\npassivity border of hold over (T5.2): delay (periods), worst motion, slow sinusoid\n");
  for (const double delay : delays(quick)) {
    const auto periods = static_cast<std::size_t>(60 * (1 + delay));
    const ImposedMotion motion = worst_motion(delay, periods);
    const ImposedMotion slow = slow_sinusoid(kSlowSamples, 4 * static_cast<std::size_t>(kSlowSamples), delay);
    json cases = json::array();
    double least = INFINITY, most = 0;
    for (const double stiffness_n_m : {10.0, 100.0, 1000.0, 10000.0})
      for (const double period_s : {0.0005, 0.005, 0.05, 0.5}) {
        const double bound = colgate_border_n_s_m(stiffness_n_m, period_s, delay * period_s);
        const double found = border_n_s_m(motion, stiffness_n_m, period_s, delay * period_s);
        const double error = std::abs(found / bound - 1);
        worst = error <= worst ? worst : error;  // NaN stays
        least = std::min(least, found / bound);
        most = std::max(most, found / bound);
        cases.push_back({stiffness_n_m, period_s, found, bound});
      }
    const double sinusoid =
        border_n_s_m(slow, 1000, 0.02, 0.02 * delay) / colgate_border_n_s_m(1000, 0.02, 0.02 * delay);
    hidden = std::max(hidden, 1 - sinusoid);
    std::printf("  %5.2f  %.4f  %.4f\n", delay, most, sinusoid);
    spread = std::max(spread, most / least - 1);
    rows.push_back({{"delay_periods", delay},
                    {"motion_periods", periods},
                    {"sinusoid_over_bound", sinusoid},
                    {"stiffness_n_m_period_s_border_bound_n_s_m", cases}});
  }
  std::printf("  over stiffness and period these differ by %.1e\n", spread);
  targets.push_back({"passivity border of hold, off Colgate's bound with delay", worst, kWithin, "of it"});
  return {{"rows", rows}, {"sinusoid_hides", hidden}, {"spread_over_stiffness_and_period", spread}};
}

void draw(const json& figures, const std::string& folder) {
  std::string script = "$found << EOD\n";
  for (const json& row : figures["rows"]) {
    const json& one = row["stiffness_n_m_period_s_border_bound_n_s_m"][0];
    const double kt = one[0].get<double>() * one[1].get<double>();
    const double bound = one[3].get<double>() / kt;
    script += fmt::format("{} {} {} {}\n", row["delay_periods"].get<double>(), one[2].get<double>() / kt,
                          bound, row["sinusoid_over_bound"].get<double>() * bound);
  }
  plot(std::filesystem::path(folder) / "stability_passivity.png",
       script +
           "EOD\nset title 'Damping that a held, delayed spring needs to be passive'\n"
           "set xlabel 'delay of the force (sampling periods)'\nset ylabel 'b / (K T)'\nset key top left\n"
           "set logscale y\nset xrange [0:11]\nset samples 1000\n"
           "e(x) = x - floor(x)\nbound(x) = 0.5 * (0.5 + x + sqrt((0.5 + x)**2 + e(x) * (1 - e(x))))\n"
           "plot bound(x) with lines lw 2 lc rgb '#999999' title 'Colgate with delay (T5.2)', "
           "$found using 1:2 with points pt 7 lc 1 title 'worst imposed motion', "
           "$found using 1:4 with points pt 6 lc 2 title 'a slow sinusoid: not the worst'\n");
}

}  // namespace

StabilityPart stability_passivity() {
  return {"passivity", measure, draw};
}

}  // namespace teletact::bench
