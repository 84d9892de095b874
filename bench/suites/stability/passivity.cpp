// The passivity border of a held, delayed spring, by the energy of its worst imposed motion on the client's
// own hold renderer, against (T5.2). What is swept is the delay: border / (K T) depends on nothing else, and
// K and T are varied only to see that the renderer keeps to that.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "bench/curves.h"
#include "bench/stability/passivity_border.h"
#include "bench/suites/stability/stability.h"

namespace teletact::bench {
namespace {

constexpr double kWithin = 0.02;  // of (T5.2)

std::vector<double> delays(bool quick) {
  std::vector<double> all{0, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9,  1,  1.25, 1.5,
                          2, 2.3,  3.7, 5,    5.5, 10,   10.7, 20, 20.5};
  if (quick) all.resize(12);
  return all;
}

struct Border {
  double stiffness_n_m = 0, period_s = 0, found_n_s_m = 0, bound_n_s_m = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Border, stiffness_n_m, period_s, found_n_s_m, bound_n_s_m)
struct DelayFigures {
  double delay_periods = 0;
  std::size_t motion_periods = 0;
  std::vector<Border> borders{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(DelayFigures, delay_periods, motion_periods, borders)
struct Figures {
  std::vector<DelayFigures> rows;
  double spread_over_stiffness_and_period = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, rows, spread_over_stiffness_and_period)

Figures measure(bool quick, Promises& promises) {
  Figures figures;
  double worst = 0;
  std::printf("\npassivity border of hold over (T5.2): delay (periods), worst motion\n");
  for (const double delay : delays(quick)) {
    const auto periods = static_cast<std::size_t>(60 * (1 + delay));
    const ImposedMotion motion = worst_motion(delay, periods);
    DelayFigures row{delay, periods};
    double least = INFINITY, most = 0;
    for (const double stiffness_n_m : {10.0, 100.0, 1000.0, 10000.0})
      for (const double period_s : {0.0005, 0.005, 0.05, 0.5}) {
        const double bound = colgate_border_n_s_m(stiffness_n_m, period_s, delay * period_s);
        const double found = border_n_s_m(motion, stiffness_n_m, period_s, delay * period_s);
        const double error = std::abs(found / bound - 1);
        worst = error <= worst ? worst : error;  // NaN stays
        least = std::min(least, found / bound);
        most = std::max(most, found / bound);
        row.borders.push_back({stiffness_n_m, period_s, found, bound});
      }
    std::printf("  %5.2f  %.4f\n", delay, most);
    double& spread = figures.spread_over_stiffness_and_period;
    spread = std::max(spread, most / least - 1);
    figures.rows.push_back(std::move(row));
  }
  std::printf("  over stiffness and period these differ by %.1e\n", figures.spread_over_stiffness_and_period);
  promises.push_back({"passivity_border_of_hold_off_colgates_bound_with_delay", worst, kWithin});
  return figures;
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  Curve worst{.title = "worst imposed motion", .style = "points pt 7 lc 1"};
  for (const DelayFigures& row : figures.rows) {
    const Border& one = row.borders.front();
    const double kt = one.stiffness_n_m * one.period_s;
    worst.add(row.delay_periods, one.found_n_s_m / kt);
  }
  plot(folder / "stability_passivity.png",
       script_of({worst},
                 "set key top left\nset logscale y\nset xrange [0:11]\nset samples 1000\n"
                 "e(x) = x - floor(x)\n"
                 "bound(x) = 0.5 * (0.5 + x + sqrt((0.5 + x)**2 + e(x) * (1 - e(x))))\n" +
                     axes("Damping that a held, delayed spring needs to be passive",
                          "delay of the force (sampling periods)", "b / (K T)"),
                 ", bound(x) with lines lw 2 lc rgb '#999999' title 'Colgate with delay (T5.2)'"));
}

}  // namespace

Part stability_passivity() {
  return make_part("passivity", measure, draw);
}

}  // namespace teletact::bench
